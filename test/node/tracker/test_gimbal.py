"""The example gimbal.py turns toward a visible target, and otherwise stands still.

Tracker, localizer and example run together.
"""

import importlib.util
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nodes import QUICK, overrides
from sensor_msgs.msg import CameraInfo

from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "gimbal.py"


@pytest.fixture
def start(graph):
    """A function that starts the example's node with parameters."""
    spec = importlib.util.spec_from_file_location("gimbal", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def start(**parameters):
        node = module.Gimbal(context=graph.context(), parameter_overrides=overrides(parameters))
        graph.run(node)
        return node

    return start


@pytest.fixture
def gimbal(start):
    """The example's node."""
    return start()


@pytest.fixture
def turns(client, gimbal, graph, images, box):
    """Its commands while a target on the left is tracked."""
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
    index = 0

    def is_turning():
        nonlocal index
        # Best effort: the first may be lost.
        cameras.publish(calibration)
        client.show(images[index % 20], client.at(index))
        index += 1
        return turns[-1] > 0.0

    client.wait_for(is_turning, "a turn to the left")
    return turns


def test_it_turns_toward_the_target_and_stands_still_without_images(client, turns):
    assert max(turns) <= 1.0
    client.wait_for(lambda: turns[-3:] == [0.0] * 3, "a standstill")


@pytest.mark.parametrize("cause", ["refused", "duplicate", "hidden"])
def test_it_stands_still_while_frames_are_skipped_or_without_the_target(
    client, turns, images, cause
):
    index = 1000

    def is_still():
        nonlocal index
        index += cause != "duplicate"
        image = {"refused": images[0][:50], "hidden": images[0] * 0}.get(cause, images[0])
        client.show(image, client.at(index))
        return turns[-3:] == [0.0] * 3

    client.wait_for(is_still, "a standstill")


def test_its_commands_have_a_stamp_where_the_driver_wants_one(client, start):
    start(stamped=True)
    commands = []
    client.create_subscription(TwistStamped, "cmd_vel", commands.append, 100)
    client.wait_for(lambda: commands, "a stamped command")
    assert commands[0].header.stamp.sec > 0
    assert commands[0].twist == Twist()
