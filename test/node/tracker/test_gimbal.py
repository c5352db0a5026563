"""The example gimbal.py turns toward a visible target, and otherwise stands still.

Tracker, localizer and example run together.
"""

from itertools import count

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nodes import QUICK, load_example, overrides
from sensor_msgs.msg import CameraInfo

from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode


@pytest.fixture
def start(graph):
    """A function that starts the example's node with parameters."""
    module = load_example("gimbal")

    def start(**parameters):
        node = module.Gimbal(context=graph.context(), parameter_overrides=overrides(parameters))
        graph.run(node)
        return node

    return start


@pytest.fixture
def turns(client, start, graph, images, box):
    """Its commands while a target on the left is tracked."""
    gimbal = start()
    turns = []
    client.create_subscription(Twist, "cmd_vel", lambda turn: turns.append(turn.angular.z), 100)
    cameras = client.create_publisher(CameraInfo, "camera_info", 10)
    localizer = LocalizerNode(context=graph.context())
    graph.run(localizer)
    graph.tracker(client, target_box=box, **QUICK)
    inputs = [s for s in localizer.subscriptions if s.topic_name in ("/pf_tracker/status",)]
    subscriptions = [s for s in gimbal.subscriptions if "parameter_events" not in s.topic_name]
    client.wait_for(
        lambda: all(s.get_publisher_count() for s in [*subscriptions, *inputs]), "connection"
    )
    client.wait_for(lambda: len(turns) > 2, "the watchdog's standstill")
    assert set(turns) == {0.0}
    height, width = images.shape[1:3]
    k = [150.0, 0.0, width / 2, 0.0, 150.0, height / 2, 0.0, 0.0, 1.0]
    calibration = CameraInfo(width=width, height=height, k=k)

    def is_turning(status):
        # Best effort: the first may be lost.
        cameras.publish(calibration)
        return turns[-1] > 0.0

    client.show_until(is_turning, images)
    return turns


def test_it_turns_toward_the_target_and_stands_still_without_images(client, turns):
    assert max(turns) <= 1.0
    client.wait_for(lambda: turns[-3:] == [0.0] * 3, "a standstill")


@pytest.mark.parametrize("cause", ["refused", "duplicate", "hidden"])
def test_it_stands_still_while_frames_are_skipped_or_without_the_target(
    client, turns, images, cause
):
    image = {"refused": images[0][:50], "hidden": images[0] * 0}.get(cause, images[0])
    stamps = (client.at(1000 + (0 if cause == "duplicate" else number)) for number in count())

    def is_still():
        client.show(image, next(stamps))
        return turns[-3:] == [0.0] * 3

    client.wait_for(is_still, "a standstill")


def test_its_commands_have_a_stamp_where_the_driver_wants_one(client, start):
    start(stamped=True)
    commands = client.collect(TwistStamped, "cmd_vel")
    client.wait_for(lambda: commands, "a stamped command")
    assert commands[0].header.stamp.sec > 0
    assert commands[0].twist == Twist()
