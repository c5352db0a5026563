"""Targets keep their ids when the parameters or the image size change."""

import copy

import cv2
import numpy as np
import pytest

from pf_tracker_ros.parameters import ParameterError

INTERVAL = 0.1


@pytest.fixture
def started(walkers, make_tracker):
    """A tracker after eight frames of the walkers."""

    def start(**parameters):
        tracker = make_tracker(**parameters)
        for number in range(8):
            found = walkers.detections(number) if number % 4 == 0 else None
            tracker.update(walkers.images[number], INTERVAL, found)
        assert [target.id for target in tracker.targets] == [1, 2, 3]
        return tracker

    return start


def follow(tracker, walkers, numbers, iou, scale=1.0):
    """Track without a detector; checks the boxes and returns the ids."""
    for number in numbers:
        image = cv2.resize(walkers.images[number], None, fx=scale, fy=scale)
        for target in tracker.update(image, INTERVAL):
            best = max(iou(target.estimate.box, scale * box) for box in walkers.boxes[number])
            assert best > 0.5, (number, target.id)
    return [target.id for target in tracker.targets]


@pytest.mark.parametrize(
    "values",
    [
        {"particles": 60, "detector.score_above": 0.5},
        {"motion.model": "constant_velocity", "proposal.method": "transition"},
        {"cues": ("color_histogram", "gradient_orientation"), "proposal.method": "transition"},
    ],
    ids=["tuned", "another motion model", "other cues"],
)
def test_targets_survive_a_change_of_parameters(started, walkers, iou, values):
    tracker = started()
    tracker.set_parameters(values)
    assert {name: tracker.parameters[name] for name in values} == values
    assert follow(tracker, walkers, range(8, 16), iou) == [1, 2, 3]


def test_late_detections_are_accepted_after_a_change_of_parameters(started, walkers):
    tracker = started()
    tracker.set_parameters({"particles": 60})
    tracker.update(walkers.images[8], INTERVAL, walkers.detections(4, age=4 * INTERVAL))
    assert tracker.rejected_detections == ()
    assert [target.id for target in tracker.targets] == [1, 2, 3]


@pytest.mark.parametrize("values", [{"particles": 0}, {"nose": 1}, {"cues": ("foreground",)}])
def test_a_refused_change_has_no_effect(started, walkers, as_told, values):
    tracker, other = started(), started()
    with pytest.raises(ParameterError):
        tracker.set_parameters({"detector.recall": 0.5, **values})
    assert tracker.parameters == other.parameters
    assert as_told(tracker.update(walkers.images[8], INTERVAL)) == as_told(
        other.update(walkers.images[8], INTERVAL)
    )


def test_an_occluded_target_is_relearned_where_it_was_last_seen(walkers, make_tracker, iou):
    tracker = make_tracker()
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    blank = np.full_like(walkers.images[0], 120)
    for _ in range(40):
        (target,) = tracker.update(blank, INTERVAL)
    state = target.estimate.state
    assert state != "tracking"
    tracker.set_parameters({"working_size": 30})
    (target,) = tracker.targets
    assert (target.id, target.estimate.state) == (1, state)
    for _ in range(30):
        (target,) = tracker.update(walkers.images[0], INTERVAL)
    assert target.estimate.state == "tracking"
    assert iou(target.estimate.box, walkers.boxes[0][0]) > 0.6


def test_a_change_is_refused_if_no_stored_frame_shows_a_target(started, walkers):
    """As in a copy, which has no frames."""
    tracker = copy.copy(started())
    with pytest.raises(
        ParameterError, match=r"target 1 must be relearned.*no stored frame shows it; stop it"
    ):
        tracker.set_parameters({"motion.model": "constant_velocity", "particles": 50})
    assert tracker.parameters["motion.model"] == "constant_velocity_and_size"
    tracker.set_parameters({"particles": 50})
    tracker.update(walkers.images[8], INTERVAL)
    tracker.set_parameters({"working_size": 30})
    assert [target.id for target in tracker.targets] == [1, 2, 3]


def test_a_lost_target_stays_lost_when_it_is_relearned(walkers, make_tracker):
    tracker = make_tracker(track__lost_after=0.5)
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    blank = np.full_like(walkers.images[0], 120)
    for _ in range(12):
        (target,) = tracker.update(blank, INTERVAL)
    assert target.estimate.state == "lost"
    tracker.set_parameters({"working_size": 30})
    (target,) = tracker.targets
    assert target.estimate.state == "lost"
    assert target.estimate.confidence == 0.0


def test_ids_are_not_reused_after_all_targets_are_removed(started, walkers):
    tracker = started()
    tracker._manager.clear()
    assert tracker.targets == ()
    for number in range(8, 13):
        targets = tracker.update(walkers.images[number], INTERVAL, walkers.detections(number))
    assert [target.id for target in targets] == [4, 5, 6]


def test_after_a_reset_images_of_any_format_are_accepted(started, walkers, start_earlier):
    tracker = started()
    tracker._manager.reset()
    gray = [image[:100, :, 0].copy() for image in walkers.images]
    assert tracker.update(gray[0], INTERVAL) == ()
    assert start_earlier(tracker, walkers.boxes[0][0]) == 4
    (target,) = tracker.update(gray[1], INTERVAL)
    assert target.id == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((10, 10, 20, 20), 60.0), "its frame is 59.300 s older than the oldest one in the buffer"),
        (((10, 10, 0, 20), 0.0), "too small"),
    ],
)
def test_an_invalid_manual_target_on_a_past_frame_is_refused(
    started, as_told, arguments, message, start_earlier
):
    tracker = started()
    before = as_told(tracker.targets)
    with pytest.raises(ValueError, match=message):
        start_earlier(tracker, *arguments)
    assert as_told(tracker.targets) == before


def test_no_target_starts_before_the_first_frame(make_tracker):
    with pytest.raises(ValueError, match="no frame yet"):
        make_tracker()._manager.start((10, 10, 20, 20))


def test_several_detector_results_at_once_equal_one_after_the_other(walkers, make_tracker):
    """Two detectors, in time and late: each result is applied at its own frame."""
    together, in_time = make_tracker(), make_tracker()
    for number in range(12):
        found = [walkers.detections(number, [0]), walkers.detections(number, [1])]
        in_time.update(walkers.images[number], INTERVAL, found if number % 4 == 0 else None)
        late = None
        if number in (2, 6, 10):
            late = [walkers.detections(number - 2, [which], age=2 * INTERVAL) for which in (1, 0)]
        together.update(walkers.images[number], INTERVAL, late)
    boxes = [{t.id: t.estimate.box for t in tracker.targets} for tracker in (together, in_time)]
    assert len(boxes[0]) == len(boxes[1]) == 2
    assert np.allclose(sorted(boxes[0].values()), sorted(boxes[1].values()), atol=4.0)


def test_detections_with_other_labels_are_ignored(walkers, make_tracker):
    tracker = make_tracker(detector__labels=("person", "dog"))
    for number in range(4):
        found = walkers.detections(number, labels=["person", "car", "dog"])
        targets = tracker.update(walkers.images[number], INTERVAL, found)
    assert sorted(target.label for target in targets) == ["dog", "person"]
    assert tracker.rejected_detections == ()
