"""Re-identification of lost targets by a detector."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import ReIdentifier, learn_others
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import TrackSet

INTERVAL, EVERY = 0.1, 5


@pytest.fixture
def track_first(run, make_tracker):
    """Tracks the first target of footage, manually started, beside a detector."""

    def track(drawn, targets=None):
        # Only the detector finds it elsewhere.
        tracker = make_tracker(redetection__windows=0)
        first = tracker.start(drawn.images[0], drawn.boxes[0][0])
        numbers = range(1, len(drawn.images))
        return first, run(tracker, drawn, numbers, every=EVERY, targets=targets)

    return track


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
    first, outputs = track_first(twins, targets=[1])
    assert len(outputs[-1]) == 2
    boxes = {target.id: target.estimate.box for target in outputs[-1]}
    assert iou(twins.boxes[-1][0], boxes[first]) > 0.7


def test_another_appearance_is_another_target(returner, track_first):
    blue = [image.copy() for image in returner.images]
    for image in blue[40:]:
        image[..., [0, 2]] = image[..., [2, 0]]
    first, outputs = track_first(type(returner)(blue, returner.boxes))
    assert sorted(ids(outputs[-1])) == [first, first + 1]


@pytest.mark.parametrize(
    ("started_as", "detected_as", "is_same"),
    [("", "person", True), ("person", "", True), ("person", "dog", False)],
)
def test_another_label_is_another_target_and_an_empty_one_matches_every_label(
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


def unit(distance):
    """A descriptor of unit length at a distance from the one with a first 1."""
    descriptor = np.zeros(3200, np.float32)
    descriptor[:2] = 1.0 - distance, np.sqrt(1.0 - (1.0 - distance) ** 2)
    return descriptor


@pytest.fixture
def missing(walkers, make_tracker):
    """A selected track of mean distance .1 that was missed for a second, and one in its place."""
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0, [0]))
    (track,) = tracker._manager._track_set.tracks
    estimate = replace(track.filter_state.estimate, state="lost")
    before = replace(
        track,
        filter_state=replace(track.filter_state, estimate=estimate),
        key=track.key._replace(frame=0),
        descriptor=unit(0.0),
        mean_appearance_distance=0.1,
        is_selected=True,
        existence_log_odds=-1.0,
        unconfirmed_for=1.0,
    )
    return before, track


@pytest.mark.parametrize(
    ("others", "distance", "is_same"),
    # The geometric mean of .1 and .9 is .3. That of .1 and .3 is less than twice .1.
    [(0.9, 0.28, True), (0.9, 0.32, False), (0.3, 0.19, True), (0.3, 0.21, False)],
)
def test_a_selected_target_may_look_as_different_as_half_way_to_the_others(
    missing, others, distance, is_same
):
    before, new = missing
    before = replace(before, others_distance=others)
    track_set = TrackSet(tracks=(before, replace(new, descriptor=unit(distance))))
    tracks = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert [track.key for track in tracks] == ([before.key] if is_same else [before.key, new.key])


@pytest.mark.parametrize(("is_selected", "factor"), [(True, np.exp(0.9)), (False, 1.0)])
def test_the_detector_that_finds_a_selected_target_counts_with_the_image(
    missing, is_selected, factor
):
    """By the odds of existence of a first detection with the score .95."""
    before, new = missing
    assert new.existence_log_odds == pytest.approx(0.9)
    before = replace(before, is_selected=is_selected, descriptor=new.descriptor)
    ended = () if is_selected else (replace(before, time_since_end=1.0),)
    track_set = TrackSet(tracks=(before, new) if is_selected else (new,), ended_tracks=ended)
    (found,) = ReIdentifier(ColorStripes()).reidentify(track_set).tracks
    assert (found.key, found.existence_log_odds) == (before.key, pytest.approx(0.9))
    assert found.filter_state.detector_factor == pytest.approx(factor)


@pytest.mark.parametrize(("log_odds", "is_compared"), [(-1.0, True), (1.0, False)])
def test_a_detection_on_the_box_of_a_missing_target_is_compared_with_it(
    missing, walkers, make_tracker, log_odds, is_compared
):
    """On that of one which only this frame's detections miss, it is taken for a poor one of it."""
    before, new = missing
    before = replace(before, existence_log_odds=log_odds, descriptor=new.descriptor)
    found = Detection(before.box, 0.9, "", new.descriptor)
    initiator = make_tracker(max_targets=4)._manager._pipeline.initiator
    frame = Frame(walkers.images[0], 1)
    track_set = initiator.initiate(TrackSet(frame=9, tracks=(before,)), frame, [(0, found)])
    assert len(track_set.tracks) == 1 + is_compared
    track_set = ReIdentifier(ColorStripes()).reidentify(track_set)
    assert [(track.key, track.unconfirmed_for) for track in track_set.tracks] == [
        (before.key, 0.0 if is_compared else 1.0)
    ]


@pytest.mark.parametrize(("distance", "is_found"), [(0.15, True), (0.25, False)])
def test_a_missing_target_with_a_detection_that_looks_like_it_starts_from_that(
    missing, walkers, make_tracker, distance, is_found
):
    """Twice the mean distance, .2, is the limit; a detection beyond moves the box alone."""
    before, _ = missing
    tracker = make_tracker(max_targets=4)
    updater = tracker._manager._pipeline._updater
    frame = Frame(walkers.images[1], 1)
    found = Detection(before.box + 2.0, 0.95, "", unit(distance))
    (track,) = updater.update([before], frame, INTERVAL, [found], 0.0)
    assert track.hits == before.hits + 1
    assert track.filter_state.followed_frames == (0 if is_found else 1)
    # From -1 up by 2.
    assert track.filter_state.detector_factor == pytest.approx(np.e if is_found else 1.0)


def test_how_others_look_is_learned_from_clear_detections_beside_a_detected_selected_target(
    missing,
):
    before, other = missing
    assigned = Detection(before.box, 0.9, "", unit(0.05))
    beside = Detection(before.box + 100.0, 0.9, "", unit(0.8))
    hidden = Detection(before.box + 50.0, 0.9, "", unit(0.5), is_clear=False)
    seen = [assigned, beside, hidden]
    learned = learn_others((before, other), [assigned, beside], seen, ColorStripes())
    # A tenth of the way from .3 to .8.
    assert learned[0].others_distance == pytest.approx(0.35)
    assert learned[1] is other
    (unseen,) = learn_others((before,), [None], seen, ColorStripes())
    assert unseen.others_distance == 0.3


def test_the_most_similar_other_counts_that_may_be_taken_for_the_target(missing):
    """Not the mean of all, nor a car that is always beside a person."""
    before, _ = missing
    person = replace(before, votes={"person": 1.0})
    own = Detection(before.box, 0.9, "person", unit(0.05))
    alike = Detection(before.box + 100.0, 0.9, "person", unit(0.2))
    different = Detection(before.box + 200.0, 0.9, "person", unit(0.9))
    car = Detection(before.box + 300.0, 0.9, "car", unit(0.9))
    (learned,) = learn_others((person,), [own], [own, different, alike], ColorStripes())
    assert learned.others_distance == pytest.approx(0.29)
    (learned,) = learn_others((person,), [own], [own, car], ColorStripes())
    assert learned.others_distance == 0.3


def test_a_new_descriptor_forgets_how_others_differed_from_the_old_one(missing, walkers):
    before, new = missing
    track = replace(before, others_distance=0.9)
    track = track.reset_descriptor(Frame(walkers.images[0], 1), new.box.tolist(), ColorStripes())
    assert track.others_distance == 0.3


def test_a_detection_on_a_missing_target_that_looks_different_starts_no_other(
    missing, walkers, make_tracker
):
    """The image may still show that target; another one on its box would hide it for good."""
    before, _ = missing
    manager = make_tracker(max_targets=4)._manager
    found = Detection(before.box, 0.9, "", unit(0.9))
    frame = Frame(np.full_like(walkers.images[0], 120), 1)
    track_set = TrackSet(frame=9, tracks=(before,), time_since_detection=0.0)
    track_set = manager._pipeline.advance(track_set, frame, INTERVAL, [found])
    assert [track.key for track in track_set.tracks] == [before.key]


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
