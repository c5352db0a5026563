"""Learning the ground from the boxes of a tracker's frames."""

from types import SimpleNamespace

import numpy as np
import pytest

from pf_tracker_ros.localization.camera_pose import CameraPoses
from pf_tracker_ros.localization.ground_learning import GroundLearning
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.sensors import BasePoses, Gravity
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import GroundPlane


@pytest.fixture
def learn(camera):
    """Shows boxes of one target, one a second; returns what was learned."""

    def show(boxes, down=None):
        learning = GroundLearning()
        for second, box in enumerate(boxes, 1):
            target = ReportedTarget(1, "", "tracking", 0.9, tuple(map(float, box)), np.eye(4))
            stamp = second * NANOSECONDS
            frame = TrackerFrame(stamp, "camera", False, "tracking", 1, (640, 480), (target,))
            learning.add(frame, camera, LocalizerParameters(), down)
        return learning

    return show


def walk(camera, box_of, distances):
    plane = GroundPlane.from_angles(2.0, 0.1)
    return [box_of(camera, plane, distance)[0] for distance in distances]


def test_one_person_who_walks_teaches_the_ground(camera, box_of, learn):
    learned = learn(walk(camera, box_of, np.linspace(5.0, 12.0, 50)))
    assert learned.plane.height == pytest.approx(2.0, rel=0.02)
    assert learned.problem == ""


def test_one_person_who_stays_at_one_place_teaches_it_with_gravity_only(camera, box_of, learn):
    boxes = walk(camera, box_of, np.linspace(5.0, 5.5, 50))
    learned = learn(boxes)
    assert learned.plane is None
    assert "the ground cannot be learned from 50 boxes" in learned.problem
    learned = learn(boxes, GroundPlane.from_angles(None, 0.1).down)
    assert learned.plane.height == pytest.approx(2.0, rel=0.02)


class Feed:
    topic, is_used, is_silent = "/imu", False, True


@pytest.mark.parametrize("frame", ["camera", "imu_link"])
def test_gravity_is_the_tilt_of_a_learned_height_where_it_can_be_used(frame):
    """The camera nods after the ground was learned."""
    gravity = Gravity(Feed())
    nodding = GroundPlane.from_angles(None, 0.3).down
    felt = SimpleNamespace(**dict(zip("xyz", -9.81 * nodding, strict=True)))
    message = SimpleNamespace(linear_acceleration=felt, linear_acceleration_covariance=[0.0] * 9)
    gravity.take(NANOSECONDS, frame, message)
    poses = CameraPoses(BasePoses(Feed()), gravity, None)
    learned = GroundPlane.from_angles(2.0, 0.1)
    found = poses.at(NANOSECONDS, "camera", LocalizerParameters(), learned)
    assert (found.mounting, found.plane.height) == ("learned", 2.0)
    assert found.has_known_tilt == (frame == "camera")
    assert found.plane.pitch == pytest.approx(0.3 if frame == "camera" else 0.1)
    if frame != "camera":
        # Nothing else says where the camera is.
        with pytest.raises(ValueError, match="rotation to the camera's frame"):
            poses.at(NANOSECONDS, "camera", LocalizerParameters(), None)


def test_only_whole_boxes_count(camera, box_of, learn):
    whole = walk(camera, box_of, np.linspace(5.0, 12.0, 49))
    # 3 px from the border are less than 2 % of the height.
    cut, none = (300, 3, 80, 300), (300, 100, 0, 100)
    assert learn([*whole, cut, none]).boxes == 49
