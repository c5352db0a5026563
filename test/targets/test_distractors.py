"""Distractors: objects that look like a target beside it."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Detections, Tracker
from pf_tracker_ros.frames import Frame

INTERVAL = 0.1
NOTHING = Detections(np.empty((0, 4)))


def distractors(tracker):
    return [track for track in tracker._manager._track_set.tracks if track.is_distractor]


def begin_distractor(tracker, drawn):
    """Track the first target until a distractor begins; the number of that frame."""
    tracker.start(drawn.images[0], drawn.boxes[0][0])
    for number, image in enumerate(drawn.images[1:], 1):
        tracker.update(image, INTERVAL)
        if distractors(tracker):
            return number
    raise AssertionError("no distractor began")


@pytest.fixture
def passing(lookalikes):
    return lookalikes["stands"]


def test_a_distractor_is_on_the_twin_and_ends_once_it_is_far(passing, make_tracker, iou):
    tracker = make_tracker()
    first = begin_distractor(tracker, passing)
    (distractor,) = distractors(tracker)
    assert iou(distractor.box, passing.boxes[first][1]) > 0.6
    for image in passing.images[first + 1 :]:
        tracker.update(image, INTERVAL)
    assert not distractors(tracker)
    # The distractor had no id.
    assert tracker.start(passing.images[-1], passing.boxes[-1][1]) == 2


def test_a_detected_distractor_becomes_a_target(passing, make_tracker, iou):
    tracker = make_tracker()
    number = begin_distractor(tracker, passing) + 1
    (distractor,) = distractors(tracker)
    only_other = passing.detections(number, targets=[1], labels=["person"])
    targets = tracker.update(passing.images[number], INTERVAL, only_other)
    assert [target.id for target in targets] == [1, 2]
    for target, truth in zip(targets, passing.boxes[number], strict=True):
        assert iou(target.estimate.box, truth) > 0.6
    assert targets[1].label == "person"
    assert targets[1].age == pytest.approx(distractor.age + INTERVAL)
    assert not distractors(tracker)


def test_a_distractor_is_reidentified_with_an_ended_track(passing, make_tracker, iou):
    tracker = make_tracker()
    for number in range(3):
        tracker.update(
            passing.images[number], INTERVAL, passing.detections(number, labels=["p", "p"])
        )
    (id,) = (one.id for one in tracker.targets if iou(one.estimate.box, passing.boxes[2][1]) > 0.5)
    track_set = tracker._manager._track_set
    ended = next(
        track for track in track_set.tracks if tracker._manager._track_ids[track.key] == id
    )
    ended_tracks = (replace(ended, time_since_end=0.0),)
    tracks = tuple(track for track in track_set.tracks if track is not ended)
    tracker._manager._track_set = replace(track_set, tracks=tracks, ended_tracks=ended_tracks)
    for number in range(3, 20):
        detections = (
            passing.detections(number, targets=[1], labels=["p"]) if distractors(tracker) else None
        )
        targets = tracker.update(passing.images[number], INTERVAL, detections)
        if detections:
            break
    assert id in [target.id for target in targets]


def test_a_distractor_ends_once_the_detector_does_not_find_it(passing, make_tracker):
    tracker = make_tracker()
    number = begin_distractor(tracker, passing) + 1
    targets = tracker.update(passing.images[number], INTERVAL, NOTHING)
    assert [target.id for target in targets] == [1]
    assert not distractors(tracker)


def test_distractors_do_not_count_as_targets(passing, make_tracker):
    tracker = make_tracker(max_targets=2)
    number = begin_distractor(tracker, passing) + 1
    far = Detections([[250.0, 20.0, 24.0, 40.0]])
    targets = tracker.update(passing.images[number], INTERVAL, far)
    assert [target.id for target in targets] == [1, 2]
    assert targets[1].estimate.box[0] > 200


def test_distractors_are_the_same_after_reprocessing(passing, make_tracker, as_told):
    outputs = []
    for late in (0, 3):
        tracker = make_tracker()
        number = begin_distractor(tracker, passing)
        for index in range(number + 1, number + 9):
            detections = None
            if index == number + 5 + late:
                detections = passing.detections(number + 5, targets=[0], age=late * INTERVAL)
            targets = tracker.update(passing.images[index], INTERVAL, detections)
        outputs.append(
            (as_told(targets), [(one.key, one.box.tolist()) for one in distractors(tracker)])
        )
    assert outputs[0] == outputs[1]


def test_a_track_set_with_a_distractor_can_be_resized(passing, make_tracker):
    tracker = make_tracker()
    number = begin_distractor(tracker, passing) + 1
    assert tracker._manager.resize(Frame(passing.images[number][::2, ::2]))
    targets = tracker.update(passing.images[number][::2, ::2], INTERVAL)
    assert [target.id for target in targets] == [1]
    assert targets[0].estimate.box[0] < passing.boxes[number][0][0]


def test_two_targets_on_one_earlier_frame_start_no_distractor_twice(
    lookalikes, make_tracker, start_earlier
):
    footage, tracker = lookalikes["approaches"], make_tracker()
    for image in footage.images[:20]:
        tracker.update(image, INTERVAL)
    for _ in range(2):
        start_earlier(tracker, footage.boxes[0][0], 19 * INTERVAL)
    for number in range(20, 26):
        keys = [track.key for track in tracker._manager._track_set.tracks]
        assert len(set(keys)) == len(keys)
        tracker.update(footage.images[number], INTERVAL, footage.detections(number))


# A single target


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("other", ["stands", "approaches"])
def test_a_single_target_passes_its_twin_and_is_not_reported_on_it(lookalikes, iou, other, seed):
    drawn, tracker = lookalikes[other], Tracker.from_preset("default", seed)
    tracker.start(drawn.images[0], drawn.boxes[0][0])
    estimates = [tracker.update(image, INTERVAL) for image in drawn.images[1:]]
    for estimate, (own, twin) in zip(estimates, drawn.boxes[1:], strict=True):
        assert estimate.state != "tracking" or iou(estimate.box, own) >= iou(estimate.box, twin)
    assert (estimates[-1].state, len(tracker._manager.targets)) == ("tracking", 1)
    assert iou(estimates[-1].box, drawn.boxes[-1][0]) > 0.6


def test_without_a_search_there_are_no_distractors(passing):
    tracker = Tracker.from_preset("li2007")
    tracker.start(passing.images[0], passing.boxes[0][0])
    for image in passing.images[1:]:
        tracker.update(image, INTERVAL)
        assert len(tracker._manager._track_set.tracks) == 1
