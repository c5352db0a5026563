"""The example follow_person.py drives a simulated robot after a target, and stops when in doubt."""

import math
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from nodes import load_example, overrides
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter


def odometry(x, y, yaw, frame="odom"):
    message = Odometry()
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z = math.sin(yaw / 2)
    message.pose.pose.orientation.w = math.cos(yaw / 2)
    return message


class Robot:
    """A robot that moves by each command for one of the follower's periods, with a localizer."""

    def __init__(self, client, period, message_type=Twist):
        self.x = self.y = self.yaw = 0.0
        self.commands = []
        self._period = period
        self._client = client
        self._odometry = client.create_publisher(Odometry, "odom", 10)
        self._status = client.create_publisher(DiagnosticArray, "localizer/status", 10)
        self.poses = client.create_publisher(Odometry, "localizer/odometry", 10)
        client.create_subscription(message_type, "cmd_vel", self._take, 10)

    def _take(self, command):
        command = getattr(command, "twist", command)
        speed, turn = command.linear.x, command.angular.z
        self.commands.append((speed, turn))
        self.yaw += turn * self._period
        self.x += speed * math.cos(self.yaw) * self._period
        self.y += speed * math.sin(self.yaw) * self._period

    def wait_for(self, is_true, what, *messages, has_localizer=True):
        """Move, and publish odometry, status and messages, until something is true."""

        def moves():
            self._odometry.publish(odometry(self.x, self.y, self.yaw))
            if has_localizer:
                self._status.publish(DiagnosticArray())
            for publisher, message in messages:
                publisher.publish(message)
            return is_true()

        self._client.wait_for(moves, what)

    def drive(self):
        """Drive after a target ahead."""
        target = odometry(self.x + 5.0, self.y, 0.0)
        self.wait_for(lambda: self.commands[-1:] > [(0.3, 0.0)], "drive", (self.poses, target))


@pytest.fixture
def module():
    """The module of the example."""
    return load_example("follow_person")


@pytest.fixture
def follow(graph, client, module):
    """A function that starts the example with parameters, and returns its robot."""

    def follow(message_type=Twist, **parameters):
        graph.run(
            module.Follower(context=graph.context(), parameter_overrides=overrides(parameters))
        )
        return Robot(client, module.PERIOD, message_type)

    return follow


def is_still(robot):
    return robot.commands[-3:] == [(0.0, 0.0)] * 3


def test_it_keeps_the_distance_and_looks_for_who_is_gone(client, module, follow):
    robot = follow()
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

    robot.wait_for(keeps_distance, "two meters between them", (robot.poses, target))
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
    turns = (-module.SEARCH_TURN, module.SEARCH_TURN)
    robot.wait_for(lambda: robot.commands[-1] in {(0.0, turn) for turn in turns}, "the search")
    count = len(robot.commands)
    client.wait_for(
        lambda: len(robot.commands) > count and robot.commands[-1] == (0.0, 0.0),
        "a standstill without odometry",
    )


def test_it_stands_still_once_tracker_or_localizer_are_gone(module, follow):
    robot = follow()
    target = odometry(3.0, 1.0, 0.0)
    robot.wait_for(lambda: len(robot.commands) > 20, "drive", (robot.poses, target))

    def is_searching():
        return abs(robot.commands[-1][1]) == module.SEARCH_TURN

    robot.wait_for(is_searching, "the search")
    robot.wait_for(lambda: is_still(robot), "a standstill", has_localizer=False)
    robot.wait_for(is_searching, "the search of a localizer that is back")


def test_it_stands_still_and_tells_once_when_the_frames_differ(follow, capfd):
    robot = follow()
    robot.drive()
    other = odometry(5.0, 0.0, 0.0, frame="map")
    robot.wait_for(lambda: is_still(robot), "a standstill", (robot.poses, other))
    place = robot.x
    count = len(robot.commands)
    robot.wait_for(lambda: len(robot.commands) > count + 20, "commands", (robot.poses, other))
    assert robot.x == place
    error = capfd.readouterr().err
    assert error.count("set the localizer's fixed_frame to 'odom'; it is 'map'") == 1
    robot.drive()


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_it_takes_no_numbers_that_are_none(client, follow, number):
    robot = follow()
    bearings = client.create_publisher(Vector3Stamped, "localizer/bearing", 10)
    robot.wait_for(lambda: is_still(robot), "commands")
    bearing = Vector3Stamped()
    bearing.vector.x, bearing.vector.z = number, 1.0
    wrong = (robot.poses, odometry(number, 0.0, 0.0)), (bearings, bearing)
    count = len(robot.commands)
    robot.wait_for(lambda: len(robot.commands) > count + 20, "commands", *wrong)
    # As with neither: it searches.
    assert set(robot.commands[count:]) <= {(0.0, 0.0), (0.0, 0.7)}
    robot.drive()


def test_it_drives_backward_only_where_that_is_wanted_and_takes_changes(client, follow):
    robot = follow()
    near = odometry(0.5, 0.0, 0.0)
    robot.wait_for(lambda: len(robot.commands) > 20, "commands", (robot.poses, near))
    assert {speed for speed, _ in robot.commands} == {0.0}

    service = client.create_client(
        SetParametersAtomically, "follow_person/set_parameters_atomically"
    )
    client.wait_for(service.service_is_ready, "service")

    def change(**values):
        request = SetParametersAtomically.Request()
        request.parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        future = service.call_async(request)
        client.wait_for(future.done, "response")
        return future.result().result

    assert change(fastest_backward=0.3, distance=1.5).successful
    robot.wait_for(lambda: robot.x < -0.5, "a drive backward", (robot.poses, near))
    assert min(speed for speed, _ in robot.commands) == -0.3
    robot.wait_for(
        lambda: abs(robot.x + 1.0) < 0.1, "the distance that is set", (robot.poses, near)
    )
    assert "range" in change(distance=-1.0).reason
    assert "expected 'Type.DOUBLE' got 'Type.INTEGER'" in change(distance=2).reason
    assert "read-only" in change(stamped=True).reason


def test_it_sends_stamped_velocities_to_drivers_that_want_them(follow):
    follow(TwistStamped, stamped=True).drive()


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("distance:=2", "expecting type 'DOUBLE'"),
        ("fastest:=-1.0", "range"),
        ("stamped:=1", "BOOL"),
    ],
)
def test_a_wrong_parameter_ends_it_with_a_sentence(graph, module, given, reason):
    process = graph.command(sys.executable, module.__file__, "--ros-args", "-p", given)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "follow_person: " in output
    assert reason in output
    assert "Traceback" not in output
