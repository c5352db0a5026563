"""What looks like a target beside it, and what that is good for."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Detections, Tracker
from pf_tracker_ros.frames import Frame

INTERVAL = 0.1
NOTHING = Detections(np.empty((0, 4)))


def rivals(tracker):
    return [track for track in tracker._manager._track_set.tracks if track.is_distractor]


def begun(tracker, drawn):
    """Follow the first target until there is a rival; the number of that frame."""
    tracker.start(drawn.images[0], drawn.boxes[0][0])
    for number, image in enumerate(drawn.images[1:], 1):
        tracker.update(image, INTERVAL)
        if rivals(tracker):
            return number
    raise AssertionError("no rival began")


@pytest.fixture
def passing(lookalikes):
    return lookalikes["who stands"]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("other", ["who stands", "who comes"])
def test_a_target_that_passes_behind_its_like_does_not_stay_with_it(
    lookalikes, make_tracker, iou, other, seed
):
    drawn, tracker = lookalikes[other], make_tracker(seed)
    name = tracker.start(drawn.images[0], drawn.boxes[0][0])
    for number, image in enumerate(drawn.images[1:], 1):
        told = tracker.update(image, INTERVAL)
        # What it is told apart from is not told itself.
        assert [target.id for target in told] == [name]
        if number > 34:
            assert iou(told[0].estimate.box, drawn.boxes[number][0]) > 0.6, number


def test_a_rival_is_where_the_look_alike_is_and_ends_once_it_is_far(passing, make_tracker, iou):
    tracker = make_tracker()
    first = begun(tracker, passing)
    (rival,) = rivals(tracker)
    assert iou(rival.box, passing.boxes[first][1]) > 0.6
    for image in passing.images[first + 1 :]:
        tracker.update(image, INTERVAL)
    assert not rivals(tracker)
    # It has had no id.
    assert tracker.start(passing.images[-1], passing.boxes[-1][1]) == 2


def test_what_the_detector_finds_of_a_rival_is_a_target_of_its_own(passing, make_tracker, iou):
    tracker = make_tracker()
    number = begun(tracker, passing) + 1
    (rival,) = rivals(tracker)
    only_other = passing.detections(number, targets=[1], labels=["person"])
    told = tracker.update(passing.images[number], INTERVAL, only_other)
    assert [target.id for target in told] == [1, 2]
    for target, truth in zip(told, passing.boxes[number], strict=True):
        assert iou(target.estimate.box, truth) > 0.6
    assert told[1].label == "person"
    assert told[1].age == pytest.approx(rival.age + INTERVAL)
    assert not rivals(tracker)


def test_a_rival_that_is_one_who_was_gone_comes_back_with_its_id(passing, make_tracker, iou):
    tracker = make_tracker()
    for number in range(3):
        tracker.update(
            passing.images[number], INTERVAL, passing.detections(number, labels=["p", "p"])
        )
    (one,) = (one.id for one in tracker.targets if iou(one.estimate.box, passing.boxes[2][1]) > 0.5)
    track_set = tracker._manager._track_set
    ended = next(
        track for track in track_set.tracks if tracker._manager._track_ids[track.key] == one
    )
    gone = (replace(ended, time_since_end=0.0),)
    tracks = tuple(track for track in track_set.tracks if track is not ended)
    tracker._manager._track_set = replace(track_set, tracks=tracks, ended_tracks=gone)
    for number in range(3, 20):
        seen = passing.detections(number, targets=[1], labels=["p"]) if rivals(tracker) else None
        told = tracker.update(passing.images[number], INTERVAL, seen)
        if seen:
            break
    assert one in [target.id for target in told]


def test_a_rival_ends_once_the_detector_does_not_find_it(passing, make_tracker):
    tracker = make_tracker()
    number = begun(tracker, passing) + 1
    told = tracker.update(passing.images[number], INTERVAL, NOTHING)
    assert [target.id for target in told] == [1]
    assert not rivals(tracker)


def test_rivals_keep_no_detection_from_starting_a_target(passing, make_tracker):
    tracker = make_tracker(max_targets=2)
    number = begun(tracker, passing) + 1
    far = Detections([[250.0, 20.0, 24.0, 40.0]])
    told = tracker.update(passing.images[number], INTERVAL, far)
    assert [target.id for target in told] == [1, 2]
    assert told[1].estimate.box[0] > 200


def test_rivals_are_the_same_when_frames_are_worked_out_again(passing, make_tracker, as_told):
    answers = []
    for late in (0, 3):
        tracker = make_tracker()
        number = begun(tracker, passing)
        for place in range(number + 1, number + 9):
            seen = None
            if place == number + 5 + late:
                seen = passing.detections(number + 5, targets=[0], age=late * INTERVAL)
            told = tracker.update(passing.images[place], INTERVAL, seen)
        answers.append((as_told(told), [(one.key, one.box.tolist()) for one in rivals(tracker)]))
    assert answers[0] == answers[1]


def test_a_crowd_with_a_rival_takes_images_of_another_size(passing, make_tracker):
    tracker = make_tracker()
    number = begun(tracker, passing) + 1
    assert tracker._manager.resize(Frame(passing.images[number][::2, ::2]))
    told = tracker.update(passing.images[number][::2, ::2], INTERVAL)
    assert [target.id for target in told] == [1]
    assert told[0].estimate.box[0] < passing.boxes[number][0][0]


def test_targets_drawn_on_one_frame_gone_by_bring_no_rival_twice(
    lookalikes, make_tracker, start_earlier
):
    footage, tracker = lookalikes["who comes"], make_tracker()
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
@pytest.mark.parametrize("other", ["who stands", "who comes"])
def test_a_single_target_passes_its_like_and_is_not_told_where_that_is(
    lookalikes, iou, other, seed
):
    drawn, tracker = lookalikes[other], Tracker.from_preset("default", seed)
    tracker.start(drawn.images[0], drawn.boxes[0][0])
    told = [tracker.update(image, INTERVAL) for image in drawn.images[1:]]
    for estimate, (own, others) in zip(told, drawn.boxes[1:], strict=True):
        assert estimate.state != "tracking" or iou(estimate.box, own) >= iou(estimate.box, others)
    assert (told[-1].state, len(tracker._manager.targets)) == ("tracking", 1)
    assert iou(told[-1].box, drawn.boxes[-1][0]) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_a_single_target_that_sits_on_its_like_is_told_as_occluded(draw, iou, seed):
    """It is gone where the two cross, and the other one goes on."""
    steps = np.arange(50)
    own = np.stack([60.0 + 3 * steps, 90.0 + 0 * steps], 1)
    own[steps > 28] = np.nan
    other = np.stack([230 - 3 * steps, 92 + 0 * steps], 1)
    drawn = draw([own, other], colors=[(20, 20, 230)] * 2, textures=(10, 10))
    tracker, on_other = Tracker.from_preset("default", seed), 0
    tracker.start(drawn.images[0], drawn.boxes[0][0])
    for number, image in enumerate(drawn.images[1:], 1):
        estimate = tracker.update(image, INTERVAL)
        if number <= 20:
            assert estimate.state == "tracking"
        elif number > 28:
            assert estimate.state == "occluded"
            on_other += iou(estimate.box, drawn.boxes[number][1]) > 0.5
    assert on_other > 10


def test_without_a_search_nothing_is_followed_beside_a_single_target(passing):
    tracker = Tracker.from_preset("li2007")
    tracker.start(passing.images[0], passing.boxes[0][0])
    for image in passing.images[1:]:
        tracker.update(image, INTERVAL)
        assert len(tracker._manager._track_set.tracks) == 1
