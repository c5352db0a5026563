"""Targets of a tracker over time: errors of its boxes that last, doubt, and predictions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.localization.box_errors import BoxErrors
from pf_tracker_ros.localization.camera_pose import CameraPose, mounted_pose
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.localization.world_tracks import Sensed, WorldTracks
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import CameraModel, GroundPlane

CAMERA = CameraModel(500.0, 500.0, 319.5, 239.5, 640, 480)
PLANE = GroundPlane.from_angles(1.5)
SENSED = Sensed(CAMERA, CameraPose(mounted_pose(PLANE), PLANE, "parameters", "still"))


def test_a_box_that_grows_is_as_uncertain_as_what_it_has_grown():
    errors, told = BoxErrors(), np.diag([1.0, 4.0, 9.0, 16.0])
    at_rest = errors.add(0, (0.0, 0.0, 40.0, 100.0), told)
    # By hand: 6 % of the size, and 3 % of the height across.
    extra = np.zeros((4, 4))
    extra[0, 0] = 3.0**2
    extra[2:, 2:] = 0.06**2 * np.outer([40, 100], [40, 100])
    np.testing.assert_allclose(at_rest, told + extra)
    # After one time constant the mean of the logarithm has moved by 1 - 1/e of the growth.
    grown = errors.add(2 * NANOSECONDS, (0.0, 0.0, 80.0, 200.0), told)
    sd = math.hypot(0.5 * math.log(2.0) / math.e, 0.06) * 200.0
    assert grown[3, 3] == pytest.approx(16.0 + sd**2)
    # It changes no more: after a long time as at rest.
    later = errors.add(100 * NANOSECONDS, (0.0, 0.0, 40.0, 100.0), told)
    later = errors.add(200 * NANOSECONDS, (0.0, 0.0, 40.0, 100.0), told)
    np.testing.assert_allclose(later, at_rest)


def test_the_growth_is_the_same_at_any_rate_of_frames():
    grown = []
    for count in (10, 100):
        errors = BoxErrors()
        for index in range(count + 1):
            share = index / count
            box = 0.0, 0.0, 40.0, 100.0 * math.exp(0.1 * share)
            total = errors.add(round(NANOSECONDS * share), box, np.zeros((4, 4)))
        grown.append(math.sqrt(total[3, 3]))
    assert grown[0] == pytest.approx(grown[1], rel=0.05)


def test_a_height_that_is_none_is_refused():
    for height in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="height of the box"):
            BoxErrors().add(0, (0.0, 0.0, 40.0, height), np.eye(4))


def silences(offsets, interval=0.1, confidence=1.0, coast=0.0):
    """Why there is no pose of a target, by its places across in meters; None where it is hidden."""
    tracks, found, parameters = WorldTracks(), [], LocalizerParameters(coast=coast)
    for index, right in enumerate(offsets):
        # Feet at 6 m, head of 1.75 m.
        lower, upper = 240.0 + 500.0 * 1.5 / 6.0, 240.0 - 500.0 * 0.25 / 6.0
        box = 320.0 + 500.0 * (right or 0.0) / 6.0 - 20.0, upper, 40.0, lower - upper
        state = "occluded" if right is None else "tracking"
        target = ReportedTarget(1, "", state, confidence, box, np.eye(4))
        stamp = round((1.0 + index * interval) * NANOSECONDS)
        frame = TrackerFrame(stamp, "camera", False, "tracking", 1, None, (target,))
        found.append(tracks.advance(frame, SENSED, parameters)[0].silence)
    return found


def test_after_a_jump_a_confident_target_is_in_doubt():
    # It is elsewhere for good: after half a second, the filter starts anew there.
    found = silences([0.0] * 20 + [2.0] * 80)
    assert not any(found[:20])
    assert all("jumped" in one for one in found[20:25])
    # Log odds of -4 by the place and 6.1 less 0.8 by the confidence: no doubt is left.
    assert not any(found[26:])
    # Of a lower confidence, it is in doubt for longer.
    found = silences([0.0] * 20 + [2.0] * 80, confidence=0.7)
    assert all("may be something else" in one for one in found[26:54])
    assert not any(found[58:])
    # One box elsewhere leaves no doubt.
    found = silences([0.0] * 20 + [2.0] + [0.0] * 20)
    assert [index for index, one in enumerate(found) if one] == [20]


@pytest.mark.parametrize("confidence", [0.7, 0.99])
def test_who_comes_back_where_he_was_expected_is_the_same_at_once(confidence):
    """Also the second time, and however low the confidence."""
    places = [0.0] * 20 + [None] * 3 + [0.0] * 10 + [None] * 5 + [0.0] * 10
    found = silences(places, confidence=confidence)
    hidden = [index for index, place in enumerate(places) if place is None]
    assert [index for index, one in enumerate(found) if one] == hidden


def test_the_pose_of_a_hidden_target_is_predicted_for_a_while():
    found = silences([0.0] * 20 + [None] * 10, coast=0.5)
    assert [index for index, one in enumerate(found) if one] == list(range(25, 30))


def seen_by_depth(shown_after, count):
    """Somebody at 6 m, and from 2 s on the same box on another depth image, made of theirs."""
    tracks, box = WorldTracks(), (300.0, 240.0 - 125.0 / 6.0, 40.0, 875.0 / 6.0)
    # Of the ground up to a wall.
    rows = np.arange(480.0)[:, None] + 0.5
    empty = np.minimum(750.0 / np.maximum(rows - 240.0, 1e-6), 9.0) * np.ones((1, 640))
    depth = empty.copy()
    depth[219:365, 307:333] = 6.0
    for index in range(count):
        target = ReportedTarget(1, "", "tracking", 0.9, box, np.eye(4))
        stamp = round((1.0 + index / 10.0) * NANOSECONDS)
        frame = TrackerFrame(stamp, "camera", False, "tracking", 1, None, (target,))
        shown = np.float32(depth if index < 20 else shown_after(depth, empty))
        sensed = replace(SENSED, depth=shown)
        yield tracks.advance(frame, sensed, LocalizerParameters())[0]


def test_depth_of_something_before_the_target_neither_silences_nor_moves_it():
    """A pane of glass at 2.5 m before somebody whose feet are seen."""
    for located in seen_by_depth(lambda depth, empty: np.minimum(depth, 2.5), 80):
        assert located.silence == ""
        assert located.world.filtered.position[0] == pytest.approx(6.0, abs=0.5)


def test_a_box_that_stays_where_depth_shows_a_wall_is_no_position():
    found = list(seen_by_depth(lambda depth, empty: empty, 45))
    assert not any(one.silence for one in found[:20])
    # The prediction stands for the target for the time `coast`.
    assert not any(one.silence for one in found[20:25])
    assert all("depth shows nothing in the box" in one.silence for one in found[25:])
    assert all(one.hint.place_odds == -4.0 for one in found[20:])
