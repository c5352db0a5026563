"""Frames that are not located: without odometry, or skipped by the tracker."""

import math

import numpy as np
import pytest
from follow_parts.messages import camera_info_message, odometry_message, plain, pose_message

from pf_tracker_ros.localization.frame_localizer import FrameLocalizer, Sensors
from pf_tracker_ros.localization.localizer_parameters import CameraParameters, LocalizerParameters
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
)
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import CameraModel

CAMERA = CameraModel(500.0, 500.0, 319.5, 239.5, 640, 480)


def lone_frame(index, state="tracking", right=0.0, *, stamp=None, is_skipped=False):
    """The frame of a tenth of a second, with a target at 6 m."""
    box = 300.0 + 500.0 * right / 6.0, 240.0 - 125.0 / 6.0, 40.0, 875.0 / 6.0
    target = ReportedTarget(1, "", state, 0.72, box, np.eye(4))
    stamp = round((1.0 + index / 10.0) * NANOSECONDS) if stamp is None else stamp
    return TrackerFrame(stamp, "camera", is_skipped, state, 1, (640, 480), (target,))


class Feed:
    """A topic that is used, or is not."""

    def __init__(self, *, is_used):
        self.topic, self.is_used, self.is_silent = "", is_used, True


class Robot:
    """A localizer that knows where the robot is, but for gaps."""

    def __init__(self):
        calibration = CameraCalibration(Feed(is_used=True))
        calibration.take(0, "camera", camera_info_message(plain, None, CAMERA))
        self._base = BasePoses(Feed(is_used=True))
        none = Feed(is_used=False)
        sensors = Sensors(calibration, DepthImages(none), self._base, Gravity(none))
        self.frames = FrameLocalizer(sensors, Problems(lambda sentence: None, math.inf))

    def locate(self, frame, *, has_odometry=True):
        if has_odometry:
            pose = pose_message(plain, 0.0, 0.0, 0.0)
            self._base.take(frame.stamp, "odom", odometry_message(plain, None, pose))
        parameters = LocalizerParameters(camera=CameraParameters(height=1.5))
        return self.frames.locate(frame, parameters, lambda: None, is_last_chance=True)


def test_who_was_hidden_while_the_odometry_was_missing_is_in_doubt():
    robot = Robot()
    for index in range(20):
        robot.locate(lone_frame(index), has_odometry=index < 18)
    for index in range(20, 30):
        assert robot.locate(lone_frame(index, "occluded"), has_odometry=False).silence
    # One and a half seconds after the last position, somebody is 2 m beside.
    found = [robot.locate(lone_frame(index, right=2.0)) for index in range(30, 40)]
    assert all(one.silence for one in found)


@pytest.mark.parametrize("stamp", [NANOSECONDS // 2, 500 * NANOSECONDS])
def test_the_stamp_of_a_skipped_image_says_nothing_of_the_time(stamp):
    robot, other = Robot(), Robot()
    for index in range(20):
        for one in (robot, other):
            one.locate(lone_frame(index, right=0.05 * index))
    assert robot.locate(lone_frame(0, stamp=stamp, is_skipped=True)).silence
    located, expected = (one.locate(lone_frame(20, right=1.0)) for one in (robot, other))
    assert located.silence == ""
    assert robot.frames.time_jumps == 0
    velocity = located.targets[0].world.filtered.velocity
    np.testing.assert_array_equal(velocity, expected.targets[0].world.filtered.velocity)
