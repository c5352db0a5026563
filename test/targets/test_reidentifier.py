"""Targets by hand that a detector finds again, where nobody has followed them to."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.targets.association import ReIdentifier
from pf_tracker_ros.targets.tracks import TrackSet

INTERVAL, EVERY = 0.1, 5


@pytest.fixture
def follow(make_tracker):
    """Follows the first target of drawn footage by hand, with a detector that sees some of it."""

    def run(drawn, finds=lambda number: None, labels=lambda number: None):
        # Only the detector looks elsewhere.
        tracker = make_tracker(redetection__windows=0)
        first = tracker.start(drawn.images[0], drawn.boxes[0][0])
        answers = []
        for number, image in enumerate(drawn.images[1:], 1):
            seen = None
            if number % EVERY == 0:
                seen = drawn.detections(number, finds(number), labels=labels(number))
            answers.append(tracker.update(image, INTERVAL, seen))
        return first, answers

    return run


def ids(answer):
    return [target.id for target in answer]


def test_one_that_the_detector_finds_elsewhere_has_its_id(returner, follow, iou):
    first, answers = follow(returner)
    (told,) = answers[-1]
    assert told.id == first
    assert iou(returner.boxes[-1][0], told.estimate.box) > 0.7
    assert told.age == pytest.approx(INTERVAL * len(answers))


def test_one_that_began_again_before_it_was_missed_gets_its_id_back(jumper, follow, iou):
    first, answers = follow(jumper)
    assert any(len(answer) == 2 for answer in answers)
    (told,) = answers[-1]
    assert told.id == first
    assert iou(jumper.boxes[-1][0], told.estimate.box) > 0.7


def test_one_that_the_image_shows_is_not_another_that_looks_like_it(twins, follow, iou):
    first, answers = follow(twins, finds=lambda number: [1])
    assert len(answers[-1]) == 2
    told = {target.id: target.estimate.box for target in answers[-1]}
    assert iou(twins.boxes[-1][0], told[first]) > 0.7


def test_what_looks_different_is_another_one(returner, follow):
    blue = [image.copy() for image in returner.images]
    for image in blue[40:]:
        image[..., [0, 2]] = image[..., [2, 0]]
    first, answers = follow(type(returner)(blue, returner.boxes))
    assert sorted(ids(answers[-1])) == [first, first + 1]


@pytest.mark.parametrize(("label", "is_same"), [("person", True), ("dog", False)])
def test_what_was_never_called_so_is_another_one(returner, follow, label, is_same):
    def labels(number):
        there = np.isfinite(returner.boxes[number]).all(axis=1).sum()
        return [label if number >= 40 else "person"] * there

    first, answers = follow(returner, labels=labels)
    assert (ids(answers[-1]) == [first]) == is_same


@pytest.mark.parametrize(
    ("asked_for", "seen", "is_same"),
    [("", "person", True), ("person", "", True), ("person", "dog", False)],
)
def test_what_nobody_has_named_may_be_anything(returner, make_tracker, asked_for, seen, is_same):
    tracker = make_tracker(redetection__windows=0)
    first = tracker.start(returner.images[0], returner.boxes[0][0], asked_for)
    for number, image in enumerate(returner.images[1:], 1):
        there = int(np.isfinite(returner.boxes[number]).all(axis=1).sum())
        is_asked = number % EVERY == 0 and number > 10
        found = returner.detections(number, labels=[seen] * there) if is_asked else None
        told = tracker.update(image, INTERVAL, found)
    assert (ids(told) == [first]) == is_same


@pytest.mark.parametrize("aside", [0, 60])
def test_a_box_around_somebody_else_is_nobody_who_was_gone(walkers, make_tracker, aside):
    by_detector, by_hand, box = make_tracker(), make_tracker(), walkers.boxes[0][0]
    by_detector.update(walkers.images[0], INTERVAL, Detections(box[None], np.ones(1)))
    by_hand.start(walkers.images[0], box + (4 + aside, 6, -8, -12))
    (begun,), (other,) = by_detector._manager._track_set.tracks, by_hand._manager._track_set.tracks
    ended = replace(begun, key=begun.key._replace(frame=0), time_since_end=INTERVAL)
    track_set = TrackSet(tracks=(begun, other), ended_tracks=(ended,))
    known, _ = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert (known.key == ended.key) == (aside == 60)


@pytest.mark.parametrize("turned", [0, 150])
def test_one_that_has_ended_is_where_the_camera_has_taken_it(walkers, make_tracker, turned):
    tracks = []
    for shift in (0, 150):
        tracker = make_tracker()
        box = walkers.boxes[0][0] + (shift, 0, 0, 0)
        image = np.roll(walkers.images[0], shift, axis=1)
        tracker.update(image, INTERVAL, Detections(box[None], np.ones(1)))
        tracks += tracker._manager._track_set.tracks
    ended, begun = tracks
    ended = replace(ended, key=ended.key._replace(frame=0), time_since_end=INTERVAL)
    motion = np.array([[1.0, 0, turned], [0, 1, 0], [0, 0, 1]])
    track_set = replace(
        TrackSet(ended_tracks=(ended,)).compensate_camera_motion(motion), tracks=(begun,)
    )
    (known,) = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert (known.key == ended.key) == (turned == 150)
