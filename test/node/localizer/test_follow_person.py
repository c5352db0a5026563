"""The example follow_person.py drives a simulated robot after a target, and stops when in doubt."""

import importlib.util
import math
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist, Vector3Stamped
from nav_msgs.msg import Odometry

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "follow_person.py"


def odometry(x, y, yaw):
    message = Odometry()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z = math.sin(yaw / 2)
    message.pose.pose.orientation.w = math.cos(yaw / 2)
    return message


class Robot:
    """A robot that moves by each command for one of the follower's periods."""

    def __init__(self, client, period):
        self.x = self.y = self.yaw = 0.0
        self.commands = []
        self._period = period
        self._client = client
        self._odometry = client.create_publisher(Odometry, "odom", 10)
        client.create_subscription(Twist, "cmd_vel", self._take, 10)

    def _take(self, command):
        speed, turn = command.linear.x, command.angular.z
        self.commands.append((speed, turn))
        self.yaw += turn * self._period
        self.x += speed * math.cos(self.yaw) * self._period
        self.y += speed * math.sin(self.yaw) * self._period

    def wait_for(self, is_true, what, *messages):
        """Move, and publish odometry and messages, until something is true."""

        def moves():
            self._odometry.publish(odometry(self.x, self.y, self.yaw))
            for publisher, message in messages:
                publisher.publish(message)
            return is_true()

        self._client.wait_for(moves, what)


@pytest.fixture
def follower(graph):
    """The module of the example, with its node running."""
    spec = importlib.util.spec_from_file_location("follow_person", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    graph.run(module.Follower(context=graph.context()))
    return module


def test_it_keeps_the_distance_and_looks_for_who_is_gone(client, follower):
    robot = Robot(client, follower.PERIOD)
    poses = client.create_publisher(Odometry, "localizer/odometry", 10)
    bearings = client.create_publisher(Vector3Stamped, "localizer/bearing", 10)
    client.wait_for(lambda: len(robot.commands) > 2, "a standstill without odometry")
    assert set(robot.commands) == {(0.0, 0.0)}

    target = odometry(3.0, 1.0, 0.0)
    # It walks on to the left of the robot, as seen from there.
    target.twist.twist.linear.y = 0.5

    def keeps_distance():
        distance = math.hypot(3.0 - robot.x, 1.0 - robot.y)
        angle = math.atan2(1.0 - robot.y, 3.0 - robot.x) - robot.yaw
        return abs(distance - 2.0) < 0.1 and abs(angle) < 0.05

    robot.wait_for(keeps_distance, "two meters between them", (poses, target))
    assert max(speed for speed, _ in robot.commands) <= 0.8
    assert max(abs(turn) for _, turn in robot.commands) <= 1.2

    # To the right by the bearing alone, which ends the pose.
    right = Vector3Stamped()
    right.vector.x, right.vector.z = 0.5, 1.0
    robot.wait_for(
        lambda: robot.commands[-1][0] == 0.0 and robot.commands[-1][1] < -0.3,
        "a turn by the bearing",
        (bearings, right),
    )
    # Without either, where it was going, and then on to that side.
    robot.wait_for(
        lambda: (
            robot.commands[-1] == (0.0, -follower.SEARCH_TURN)
            or robot.commands[-1] == (0.0, follower.SEARCH_TURN)
        ),
        "the search",
    )
    count = len(robot.commands)
    client.wait_for(
        lambda: len(robot.commands) > count and robot.commands[-1] == (0.0, 0.0),
        "a standstill without odometry",
    )
