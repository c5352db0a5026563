#!/usr/bin/env python3
"""A recording through the real nodes as a test of `launch_testing`, for packages that use it.

It replays a recording in lockstep and compares the boxes that the tracker publishes with those of
a `boxes.csv`, which `track` or `pytest --update` has written, in figures and not in bits:

    track drive.mcap --box 42,188,44,132 --output tracked
    launch_test examples/replay_launch_test.py source:=drive.mcap boxes:=tracked/boxes.csv

In a package of one's own, `add_launch_test` of `launch_testing_ament_cmake` runs it with the tests.
"""

from __future__ import annotations

import csv
import time
import unittest
from collections.abc import Callable
from pathlib import Path
from typing import Any

import launch_testing
import numpy as np
import pytest
import rclpy
from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_testing.actions import ReadyToTest
from rclpy.qos import HistoryPolicy, QoSProfile
from std_srvs.srv import SetBool

from pf_tracker_ros.evaluation import metrics

PACKAGE = "pf_tracker_ros"
# What the tracker has to hold.
LEAST_OVERLAP = 0.8
LONGEST_LOSS = 0.5
# Seconds without news after which something hangs.
PATIENCE = 30.0
EVERYTHING = QoSProfile(history=HistoryPolicy.KEEP_ALL)


def stored_boxes(path: str) -> dict[int, list[float] | None]:
    """Stamp of each frame to its box, None where there is none."""
    with Path(path).open(newline="") as file:
        return {
            int(row["stamp"]): [float(row[name]) for name in ("x", "y", "width", "height")]
            if row["x"]
            else None
            for row in csv.DictReader(file)
        }


def start_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """The tracker, and the replay publisher, which waits to be started."""
    expected = stored_boxes(LaunchConfiguration("boxes").perform(context))
    launch_file = Path(get_package_share_directory(PACKAGE)) / "launch" / "tracker.launch.py"
    tracker = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(launch_file)),
        launch_arguments={"image": "image", "image_reliability": "reliable"}.items(),
    )
    replay = Node(
        package=PACKAGE,
        executable="replay",
        arguments=[LaunchConfiguration("source").perform(context)],
        parameters=[
            {
                "lockstep": True,
                "start_paused": True,
                "target_box": next(box for box in expected.values() if box is not None),
            }
        ],
    )
    return [tracker, replay]


@pytest.mark.launch_test
def generate_test_description() -> LaunchDescription:
    """The nodes of the test and what it is given."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("source", description="The recording."),
            DeclareLaunchArgument("boxes", description="boxes.csv to compare with."),
            OpaqueFunction(function=start_nodes),
            ReadyToTest(),
        ]
    )


class ReplayTest(unittest.TestCase):
    """Hears what the tracker says of the whole recording."""

    def setUp(self) -> None:
        """Listen."""
        rclpy.init()
        self.node = rclpy.create_node("listener")
        self.boxes: dict[int, list[float]] = {}
        self.states: dict[int, str] = {}
        self.node.create_subscription(PolygonStamped, "pf_tracker/box", self.on_box, EVERYTHING)
        self.node.create_subscription(
            DiagnosticArray, "pf_tracker/status", self.on_status, EVERYTHING
        )

    def tearDown(self) -> None:
        """Listen no more."""
        self.node.destroy_node()
        rclpy.shutdown()

    def on_box(self, message: PolygonStamped) -> None:
        """Remember the box of a frame."""
        corners = message.polygon.points
        left, top = corners[0].x, corners[0].y
        self.boxes[stamp_of(message)] = [left, top, corners[2].x - left, corners[2].y - top]

    def on_status(self, message: DiagnosticArray) -> None:
        """Remember the state after a frame."""
        values = {item.key: item.value for item in message.status[0].values}
        self.states[stamp_of(message)] = values.get("state", "")

    def test_the_boxes_are_those_of_before(self, proc_info: Any, test_args: Any) -> None:
        """The boxes lie on the stored ones, and no target that has one is lost for long."""
        expected = stored_boxes(test_args["boxes"])
        start = self.node.create_client(SetBool, "replay/pause")
        self.wait(lambda: self.node.count_publishers("pf_tracker/box") == 1, "no tracker came")
        self.wait(start.service_is_ready, "no replay came")
        start.call_async(SetBool.Request(data=False))
        self.wait(lambda: expected.keys() <= self.states.keys(), "the replay did not end")
        proc_info.assertWaitForShutdown("replay", timeout=PATIENCE)
        held = [stamp for stamp, box in expected.items() if box is not None]
        found = [self.boxes.get(stamp, [0.0] * 4) for stamp in held]
        overlaps = metrics.overlap(np.array(found), np.array([expected[stamp] for stamp in held]))
        worst = held[int(overlaps.argmin())]
        assert overlaps.mean() >= LEAST_OVERLAP, f"{overlaps.mean():.3f}, least at {worst} ns"
        last_seen = min(expected)
        for stamp in sorted(expected):
            # Where the stored target was lost, too, nothing is.
            if self.states[stamp] != "lost" or expected[stamp] is None:
                last_seen = stamp
            assert (stamp - last_seen) / 1e9 <= LONGEST_LOSS, f"still lost at {stamp} ns"

    def wait(self, condition: Callable[[], bool], complaint: str) -> None:
        """Listen until a condition holds; there is news all the time, or the test fails."""
        heard, deadline = 0, time.monotonic() + PATIENCE
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.1)
            if len(self.states) > heard:
                heard, deadline = len(self.states), time.monotonic() + PATIENCE
            assert time.monotonic() < deadline, complaint


@launch_testing.post_shutdown_test()
class EndTest(unittest.TestCase):
    """After all has ended."""

    def test_all_ended_well(self, proc_info: Any) -> None:
        """No process has failed."""
        launch_testing.asserts.assertExitCodes(proc_info)


def stamp_of(message: PolygonStamped | DiagnosticArray) -> int:
    """Of the header, nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
