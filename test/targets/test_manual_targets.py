"""Manual targets: started and stopped by a call, with and without a detector."""

import copy
import itertools

import numpy as np
import pytest
from common import overlap

from pf_tracker_ros import Detections

INTERVAL = 0.1


def test_a_manual_target_is_reported_until_it_is_stopped(walkers, make_tracker):
    tracker = make_tracker()
    first = tracker.start(walkers.images[0], walkers.boxes[0][0], "mine")
    no_detections = Detections([])
    for number in range(1, 20):
        targets = tracker.update(walkers.images[number], INTERVAL, no_detections)
        assert [(target.id, target.label) for target in targets] == [(first, "mine")]
        assert overlap(walkers.boxes[number][0], targets[0].estimate.box) > 0.5
    second = tracker.start(walkers.images[19], walkers.boxes[19][1])
    assert [target.id for target in tracker.targets] == [first, second]
    tracker.stop(first)
    assert [target.id for target in tracker.update(walkers.images[20], INTERVAL)] == [second]
    third = tracker.start(walkers.images[20], walkers.boxes[20][2])
    assert len({first, second, third}) == 3


def test_a_stopped_target_stays_stopped_after_a_late_detection(run, walkers, make_tracker):
    tracker = make_tracker()
    number = tracker.start(walkers.images[0], walkers.boxes[0][0])
    run(tracker, walkers, range(1, 6))
    tracker.stop(number)
    late = walkers.detections(3, targets=[1], age=4 * INTERVAL)
    tracker.update(walkers.images[6], INTERVAL)
    targets = tracker.update(walkers.images[7], INTERVAL, late)
    assert number not in [target.id for target in targets]


@pytest.mark.parametrize("label_age_late", itertools.product(("mine", ""), (0, 3), (False, True)))
def test_a_box_on_a_detected_target_is_that_target(
    run, walkers, make_tracker, label_age_late, start_earlier
):
    """It keeps its id, and no detector ends it any more; also after reprocessing."""
    tracker, (label, age, late) = make_tracker(), label_age_late
    targets = run(tracker, walkers, range(8), every=4, labels=["person"] * 3)[-1]
    wanted = max(targets, key=lambda one: overlap(one.estimate.box, walkers.boxes[7][1])).id
    assert start_earlier(tracker, walkers.boxes[7 - age][1], age * INTERVAL, label) == wanted
    assert [target.id for target in tracker.targets] == [1, 2, 3]
    for number in range(8, 24):
        detected_on = 6 if late and number == 10 else number
        detections = None
        if detected_on < number or number % 4 == 0:
            detections = walkers.detections(
                detected_on, [0, 2], (number - detected_on) * INTERVAL, ["person"] * 2
            )
        targets = {
            one.id: one for one in tracker.update(walkers.images[number], INTERVAL, detections)
        }
        assert sorted(targets) == [1, 2, 3]
    assert targets[wanted].label == (label or "person")
    assert overlap(targets[wanted].estimate.box, walkers.boxes[23][1]) > 0.5


def test_a_second_box_on_a_target_corrects_it(run, walkers, make_tracker, start_earlier):
    """Also with the maximum number of targets, on the same frame and on an earlier one."""
    tracker = make_tracker(max_targets=2)
    first = tracker.start(walkers.images[0], walkers.boxes[0][0], "mine")
    second = tracker.start(walkers.images[0], walkers.boxes[0][1])
    assert tracker.start(walkers.images[0], walkers.boxes[0][0] + (3, 2, 0, 0)) == first
    for targets in run(tracker, walkers, range(1, 8)):
        assert [target.id for target in targets] == [first, second]
    assert targets[0].label == "mine"
    assert start_earlier(tracker, walkers.boxes[4][1], 3 * INTERVAL, "other") == second
    with pytest.raises(ValueError, match="the maximum"):
        tracker.start(walkers.images[7], walkers.boxes[7][2])
    late = walkers.detections(5, targets=[0], age=3 * INTERVAL)
    for number in range(8, 20):
        targets = tracker.update(walkers.images[number], INTERVAL, late if number == 8 else None)
        assert [(target.id, target.label) for target in targets][1:] == [(second, "other")]
    for place in (0, 1):
        assert overlap(targets[place].estimate.box, walkers.boxes[19][place]) > 0.5


def test_a_box_on_a_lost_target_is_a_new_one(walkers, make_tracker):
    tracker = make_tracker()
    first = tracker.start(walkers.images[0], walkers.boxes[0][0])
    blank = np.full_like(walkers.images[0], 90)
    for _ in range(60):
        (target,) = tracker.update(blank, INTERVAL)
    assert target.estimate.state == "lost"
    assert tracker.start(blank, target.estimate.box) != first
    assert len(tracker.targets) == 2


@pytest.mark.parametrize("received", [7, 8, 10])
def test_a_detected_target_stays_stopped_after_an_earlier_detection(
    walkers, make_tracker, received
):
    """The detection of frame 2 starts the target of frame 4 two frames earlier, as another one."""
    tracker = make_tracker()
    for frame in range(12):
        detections = []
        if frame == 4:
            detections.append(walkers.detections(4, targets=[1]))
        if frame == received:
            detections.append(walkers.detections(2, targets=[1], age=(received - 2) * INTERVAL))
        targets = tracker.update(walkers.images[frame], INTERVAL, detections)
        if frame == 5:
            tracker.stop(targets[0].id)
        elif frame > 5:
            assert targets == ()


@pytest.mark.parametrize("seed", range(3))
def test_without_a_detector_the_size_comes_from_the_image(approacher, make_tracker, seed):
    """The target grows by a factor of 1.7; in its first size the IoU would be 0.35."""
    tracker = make_tracker(seed)
    tracker.start(approacher.images[0], approacher.boxes[0][0])
    for image in approacher.images[1:]:
        (target,) = tracker.update(image, INTERVAL)
    assert overlap(approacher.boxes[-1][0], target.estimate.box) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_after_the_last_detection_the_size_comes_from_the_image(approacher, make_tracker, seed):
    tracker = make_tracker(seed)
    tracker.update(approacher.images[0], INTERVAL, approacher.detections(0))
    still = approacher.images[-1]
    for image in (*approacher.images[1:], *[still] * 50):
        (target,) = tracker.update(image, INTERVAL)
    assert overlap(approacher.boxes[-1][0], target.estimate.box) > 0.6


def test_starting_on_another_image_than_the_last_is_refused(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    with pytest.raises(ValueError, match="not the last one passed to update"):
        tracker.start(walkers.images[5], walkers.boxes[5][0])
    assert len(tracker.update(walkers.images[1], INTERVAL)) == 3


def test_stopping_an_unknown_id_names_the_known_ones(walkers, make_tracker):
    tracker = make_tracker()
    number = tracker.start(walkers.images[0], walkers.boxes[0][0])
    for wrong in (number + 1, 0, "1", None, True):
        with pytest.raises(ValueError, match=f"there are: {number}"):
            tracker.stop(wrong)


def test_an_image_with_nan_pixels_is_recognized_as_the_last_one(walkers, make_tracker):
    image = walkers.images[0].mean(axis=2).astype(np.float32)
    image[3, 5] = np.nan
    tracker = make_tracker()
    tracker.start(image, walkers.boxes[0][0])
    tracker.start(image, walkers.boxes[0][1])
    tracker.update(image, INTERVAL)
    tracker.start(image, walkers.boxes[0][2])
    assert len(tracker.targets) == 3


def test_a_copy_requires_a_frame_before_it_starts_a_target(walkers, make_tracker, start_earlier):
    tracker = make_tracker()
    tracker.start(walkers.images[0], walkers.boxes[0][0])
    other = copy.deepcopy(tracker)
    for start in (
        lambda: other.start(walkers.images[0], walkers.boxes[0][1]),
        lambda: start_earlier(other, walkers.boxes[0][1]),
    ):
        with pytest.raises(ValueError, match="no frame yet, as in a new copy; pass one"):
            start()
    other.update(walkers.images[0], INTERVAL)
    other.start(walkers.images[0], walkers.boxes[0][1])
    assert len(other.targets) == 2


def test_corrections_on_one_frame_keep_the_targets_separate(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL)
    x, y, width, height = walkers.boxes[0][0]
    first = [
        tracker.start(walkers.images[0], (x + shift, y, width, height)) for shift in (-3, -1, 0)
    ]
    second = tracker.start(walkers.images[0], walkers.boxes[0][1])
    assert first == [1, 1, 1]
    assert second == 2
    for number in range(1, 8):
        late = walkers.detections(0, age=6 * INTERVAL) if number == 6 else None
        targets = tracker.update(walkers.images[number], INTERVAL, late)
        boxes = {target.id: target.estimate.box for target in targets}
        for id in (1, 2):
            assert overlap(walkers.boxes[number][id - 1], boxes[id]) > 0.5


def test_a_box_on_an_earlier_frame_is_the_target_detected_since(
    run, walkers, make_tracker, start_earlier
):
    tracker = make_tracker()
    run(tracker, walkers, range(6))
    known = {target.id for target in run(tracker, walkers, range(6, 12), every=2)[-1]}
    id = start_earlier(tracker, walkers.boxes[5][0], 6 * INTERVAL, "")
    assert {target.id for target in tracker.targets} == known
    assert id in known
    for number in range(12, 16):
        late = walkers.detections(number - 3, age=3 * INTERVAL)
        tracker.update(walkers.images[number], INTERVAL, late)
        assert {target.id for target in tracker.targets} == known
