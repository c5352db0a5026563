"""The ground that targets share: heights of boxes from their lower edges."""

import cv2
import numpy as np
import pytest
from scipy.stats import t as student

from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.external_likelihoods import Ground, fit_grounds

INTERVAL = 0.1
# The horizon is at y = 0; the height is a fifth of the distance of the lower edge from it.
STANDING = np.array(
    [[10.0, 160.0, 16.0, 40.0], [60.0, 240.0, 24.0, 60.0], [150.0, 320.0, 32.0, 80.0]]
)
HEIGHTS = np.linspace(5.0, 200.0, 3901)


def heights_at(lower_edge):
    """Boxes of all heights on one lower edge."""
    zeros = np.zeros_like(HEIGHTS)
    return BoxesByAxis(zeros, lower_edge - HEIGHTS, zeros, HEIGHTS)


@pytest.mark.parametrize(
    ("ground_box", "lower_edge", "expected"),
    [
        ([0.0, 160.0, 10.0, 40.0], 300.0, 60.0),
        # A child keeps its ratio to the line.
        ([0.0, 180.0, 10.0, 20.0], 300.0, 30.0),
        ([0.0, 320.0, 10.0, 80.0], 200.0, 40.0),
        ([0.0, 320.0, 10.0, 80.0], 400.0, 80.0),
        # Beyond the horizon the line ends at a quarter of the mean, 60.
        ([0.0, 160.0, 10.0, 40.0], -50.0, 15.0),
    ],
)
def test_the_likeliest_height_follows_the_ground(ground_box, lower_edge, expected):
    ground = Ground.fit(STANDING)
    found = ground.log_likelihood(np.array(ground_box), heights_at(lower_edge))
    assert HEIGHTS[found.argmax()] == pytest.approx(expected, rel=0.01)


def test_the_likelihood_is_the_prediction_of_a_regression():
    """Line and residuals by NumPy, t distribution by SciPy."""
    lower_edges = np.array([200.0, 260.0, 310.0, 400.0, 420.0])
    heights = np.array([41.0, 50.0, 66.0, 75.0, 88.0])
    zeros = np.zeros(5)
    ground = Ground.fit(np.column_stack([zeros, lower_edges - heights, zeros + 9.0, heights]))
    line, (residuals, *_) = np.polynomial.Polynomial.fit(lower_edges, heights, 1, full=True)
    std = np.sqrt((2.0 * (0.1 * heights.mean()) ** 2 + residuals[0]) / 5.0)
    ground_box = np.array([0.0, 150.0, 10.0, 50.0])
    for lower_edge in (200.0, 280.0, 420.0):
        distance = np.square(lower_edge - 200.0) / np.square(lower_edges - lower_edges.mean()).sum()
        scale = 0.5 * std / line(lower_edge) * np.sqrt(1.0 + distance)
        expected = 50.0 * line(lower_edge) / line(200.0)
        wanted = student.logpdf(np.log(HEIGHTS / expected) / scale, 3)
        found = ground.log_likelihood(ground_box, heights_at(lower_edge))
        assert found - found.max() == pytest.approx(wanted - wanted.max(), abs=1e-3)


def test_two_targets_are_too_few():
    assert Ground.fit(STANDING[:2]) is None
    assert Ground.fit(np.empty((0, 4))) is None


def test_targets_on_no_common_ground_have_little_effect():
    """Log likelihood ratio of the line's height to half of it."""
    unlike = np.tile(STANDING, (2, 1))
    unlike[:, 3] = [80.0, 12.0, 40.0, 20.0, 90.0, 8.0]
    ground_box = np.array([0.0, 240.0, 10.0, 60.0])
    ratios = []
    for boxes in (STANDING, unlike):
        ground = Ground.fit(boxes)
        found = ground.log_likelihood(ground_box, heights_at(300.0))
        half = 0.5 * HEIGHTS[found.argmax()]
        ratios.append(found.max() - np.interp(half, HEIGHTS, found))
    assert ratios[0] > 8.0
    assert ratios[1] < 0.2 * ratios[0]


@pytest.fixture
def start_walkers(walkers, make_tracker):
    """The track set of the three walkers, manually started with labels."""

    def start(labels, image=walkers.images[0]):
        tracker = make_tracker()
        for box, label in zip(walkers.boxes[0], labels, strict=True):
            tracker.start(image, box, label)
        return tracker._manager._track_set

    return start


def test_each_label_has_a_ground_of_its_own(start_walkers):
    assert fit_grounds(start_walkers(["person", "person", "car"]).tracks) == {}
    (label, ground), *others = fit_grounds(start_walkers(["person"] * 3).tracks).items()
    assert (label, others) == ("person", [])
    # All have one height on three lower edges.
    assert (ground.line.height, ground.line.slope) == pytest.approx((40.0, 0.0))


def test_camera_motion_resets_the_ground(start_walkers):
    motion = np.array([[1.0, 0.0, 8.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert fit_grounds(start_walkers(["person"] * 3).compensate_camera_motion(motion).tracks) == {}


def test_a_box_cut_by_the_border_is_not_used(walkers, make_tracker):
    tracker = make_tracker()
    box = walkers.boxes[0][0]
    tracker.start(walkers.images[0], (0.0, box[1], box[0] + box[2], box[3]))
    (track,) = tracker._manager._track_set.tracks
    assert track.ground_box is None


def test_detections_update_the_ground_box(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    taller = walkers.boxes[1] + (0.0, -8.0, 0.0, 8.0)
    tracker.update(walkers.images[1], INTERVAL, Detections(taller, np.full(3, 0.95)))
    for track, box, before in zip(
        tracker._manager._track_set.tracks, walkers.boxes[1], walkers.boxes[0], strict=True
    ):
        assert before[3] < track.ground_box[3] < before[3] + 8.0
        assert track.ground_box[:2] + track.ground_box[2:] / 2 == pytest.approx(
            box[:2] + box[2:] / 2, abs=5.0
        )


def test_the_ground_box_scales_with_the_image(walkers, make_tracker):
    tracker = make_tracker()
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    assert tracker._manager.resize(Frame(cv2.resize(walkers.images[0], None, fx=2.0, fy=2.0)))
    (track,) = tracker._manager._track_set.tracks
    assert track.ground_box == pytest.approx(2.0 * walkers.boxes[0][0])


def size_errors(drawn, labels, make_tracker, seed):
    """Mean error of the first target's log height; all start in the first frame."""
    tracker = make_tracker(seed)
    for box, label in zip(drawn.boxes[0], labels, strict=True):
        tracker.start(drawn.images[0], box, label)
    errors = []
    for image, boxes in zip(drawn.images[1:], drawn.boxes[1:], strict=True):
        target, *_ = tracker.update(image, INTERVAL)
        errors.append(abs(np.log(target.estimate.box[3] / boxes[0][3])))
    return np.mean(errors)


def test_an_approaching_target_gets_the_size_of_those_beside_it(comer, make_tracker):
    """Without a detector; targets with labels of their own share no ground."""
    common, separate = (
        np.mean([size_errors(comer, labels, make_tracker, seed) for seed in range(3)])
        for labels in (["person"] * 4, ["a", "b", "c", "d"])
    )
    assert common < 0.08
    assert common < 0.8 * separate
