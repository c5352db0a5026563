"""Re-identification of lost targets by a detector."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.targets.association import ReIdentifier
from pf_tracker_ros.targets.tracks import TrackSet

INTERVAL, EVERY = 0.1, 5


@pytest.fixture
def track_first(make_tracker):
    """Tracks the first target of footage, manually started, beside a detector."""

    def run(drawn, targets=lambda number: None, labels=lambda number: None):
        # Only the detector finds it elsewhere.
        tracker = make_tracker(redetection__windows=0)
        first = tracker.start(drawn.images[0], drawn.boxes[0][0])
        outputs = []
        for number, image in enumerate(drawn.images[1:], 1):
            detections = None
            if number % EVERY == 0:
                detections = drawn.detections(number, targets(number), labels=labels(number))
            outputs.append(tracker.update(image, INTERVAL, detections))
        return first, outputs

    return run


def ids(output):
    return [target.id for target in output]


def test_a_lost_target_that_the_detector_finds_elsewhere_keeps_its_id(returner, track_first, iou):
    first, outputs = track_first(returner)
    (target,) = outputs[-1]
    assert target.id == first
    assert iou(returner.boxes[-1][0], target.estimate.box) > 0.7
    assert target.age == pytest.approx(INTERVAL * len(outputs))


def test_a_track_started_before_the_target_was_missed_gets_its_id_later(jumper, track_first, iou):
    first, outputs = track_first(jumper)
    assert any(len(output) == 2 for output in outputs)
    (target,) = outputs[-1]
    assert target.id == first
    assert iou(jumper.boxes[-1][0], target.estimate.box) > 0.7


def test_a_target_seen_in_the_image_is_not_reidentified_with_its_twin(twins, track_first, iou):
    first, outputs = track_first(twins, targets=lambda number: [1])
    assert len(outputs[-1]) == 2
    boxes = {target.id: target.estimate.box for target in outputs[-1]}
    assert iou(twins.boxes[-1][0], boxes[first]) > 0.7


def test_another_appearance_is_another_target(returner, track_first):
    blue = [image.copy() for image in returner.images]
    for image in blue[40:]:
        image[..., [0, 2]] = image[..., [2, 0]]
    first, outputs = track_first(type(returner)(blue, returner.boxes))
    assert sorted(ids(outputs[-1])) == [first, first + 1]


@pytest.mark.parametrize(("label", "is_same"), [("person", True), ("dog", False)])
def test_a_label_that_the_target_never_had_is_another_target(returner, track_first, label, is_same):
    def labels(number):
        there = np.isfinite(returner.boxes[number]).all(axis=1).sum()
        return [label if number >= 40 else "person"] * there

    first, outputs = track_first(returner, labels=labels)
    assert (ids(outputs[-1]) == [first]) == is_same


@pytest.mark.parametrize(
    ("started_as", "detected_as", "is_same"),
    [("", "person", True), ("person", "", True), ("person", "dog", False)],
)
def test_an_empty_label_matches_every_label(
    returner, make_tracker, started_as, detected_as, is_same
):
    tracker = make_tracker(redetection__windows=0)
    first = tracker.start(returner.images[0], returner.boxes[0][0], started_as)
    for number, image in enumerate(returner.images[1:], 1):
        there = int(np.isfinite(returner.boxes[number]).all(axis=1).sum())
        is_due = number % EVERY == 0 and number > 10
        found = returner.detections(number, labels=[detected_as] * there) if is_due else None
        targets = tracker.update(image, INTERVAL, found)
    assert (ids(targets) == [first]) == is_same


@pytest.mark.parametrize("aside", [0, 60])
def test_a_detection_around_another_target_is_not_reidentified(walkers, make_tracker, aside):
    detected, manual, box = make_tracker(), make_tracker(), walkers.boxes[0][0]
    detected.update(walkers.images[0], INTERVAL, Detections(box[None], np.ones(1)))
    manual.start(walkers.images[0], box + (4 + aside, 6, -8, -12))
    (new,), (other,) = detected._manager._track_set.tracks, manual._manager._track_set.tracks
    ended = replace(new, key=new.key._replace(frame=0), time_since_end=INTERVAL)
    track_set = TrackSet(tracks=(new, other), ended_tracks=(ended,))
    track, _ = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert (track.key == ended.key) == (aside == 60)


@pytest.mark.parametrize("turned", [0, 150])
def test_camera_motion_moves_ended_tracks(walkers, make_tracker, turned):
    tracks = []
    for shift in (0, 150):
        tracker = make_tracker()
        box = walkers.boxes[0][0] + (shift, 0, 0, 0)
        image = np.roll(walkers.images[0], shift, axis=1)
        tracker.update(image, INTERVAL, Detections(box[None], np.ones(1)))
        tracks += tracker._manager._track_set.tracks
    ended, new = tracks
    ended = replace(ended, key=ended.key._replace(frame=0), time_since_end=INTERVAL)
    motion = np.array([[1.0, 0, turned], [0, 1, 0], [0, 0, 1]])
    track_set = replace(
        TrackSet(ended_tracks=(ended,)).compensate_camera_motion(motion), tracks=(new,)
    )
    (track,) = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert (track.key == ended.key) == (turned == 150)
