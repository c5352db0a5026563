"""Targets keep their ids when the parameters or the image size change."""

import copy

import numpy as np
import pytest

from pf_tracker_ros.parameters import ParameterError

INTERVAL = 0.1


@pytest.fixture
def started(run, walkers, make_tracker):
    """A tracker after eight frames of the walkers."""
    tracker = make_tracker()
    (*_, targets) = run(tracker, walkers, range(8), every=4)
    assert [target.id for target in targets] == [1, 2, 3]
    return tracker


@pytest.mark.parametrize(
    "values",
    [
        {"particles": 60, "detector.score_above": 0.5},
        {"motion.model": "constant_velocity", "proposal.method": "transition"},
        {"cues": ("color_histogram", "gradient_orientation"), "proposal.method": "transition"},
    ],
    ids=["tuned", "another motion model", "other cues"],
)
def test_targets_survive_a_change_of_parameters(run, started, walkers, iou, values):
    started.set_parameters(values)
    assert {name: started.parameters[name] for name in values} == values
    for number, targets in enumerate(run(started, walkers, range(8, 16)), 8):
        assert [target.id for target in targets] == [1, 2, 3]
        for target in targets:
            assert max(iou(target.estimate.box, box) for box in walkers.boxes[number]) > 0.5


def test_late_detections_are_accepted_after_a_change_of_parameters(started, walkers):
    started.set_parameters({"particles": 60})
    started.update(walkers.images[8], INTERVAL, walkers.detections(4, age=4 * INTERVAL))
    assert started.rejected_detections == ()
    assert [target.id for target in started.targets] == [1, 2, 3]


def test_a_change_is_refused_if_no_stored_frame_shows_a_target(started, walkers):
    """As in a copy, which has no frames."""
    tracker = copy.copy(started)
    with pytest.raises(
        ParameterError, match=r"target 1 must be relearned.*no stored frame shows it; stop it"
    ):
        tracker.set_parameters({"motion.model": "constant_velocity", "particles": 50})
    assert tracker.parameters["motion.model"] == "constant_velocity_and_size"
    tracker.set_parameters({"particles": 50})
    tracker.update(walkers.images[8], INTERVAL)
    tracker.set_parameters({"working_size": 30})
    assert [target.id for target in tracker.targets] == [1, 2, 3]


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
