from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import Associator, correct_id_switches
from pf_tracker_ros.targets.detections import Detection, Detections, describe_detections

INTERVAL = 0.1
STRIPES = ColorStripes()


@pytest.fixture
def tracks(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    return sorted(tracker._manager._track_set.tracks, key=lambda track: track.box[1])


def detect(track, shift=0.0, descriptor=None):
    """A detection of a track, shifted by widths, or with another descriptor."""
    box = track.box + np.array([shift * track.box[2], 0.0, 0.0, 0.0])
    return Detection(box, 0.95, "", track.descriptor if descriptor is None else descriptor)


def between(one, other, distance):
    """A blend of two descriptors at a distance from the first one."""
    shares = np.linspace(0.0, 1.0, 400)
    blends = [STRIPES.blend(one, other, share) for share in shares]
    return min(blends, key=lambda blend: abs(STRIPES.distance(one, blend[None])[0] - distance))


def test_the_detection_of_a_neighbor_is_not_assigned_to_an_undetected_track(tracks):
    red, blue, _ = tracks
    assert Associator(STRIPES).assign([red], [detect(red, 0.7)]) == {0: 0}
    unlike = detect(red, 0.7, between(red.descriptor, blue.descriptor, 0.4))
    assert Associator(STRIPES).assign([red], [unlike]) == {}


def test_a_detection_beyond_the_gate_is_not_assigned_however_alike(tracks):
    red, _, _ = tracks
    assert Associator(STRIPES).assign([red], [detect(red, 1.5)]) == {0: 0}
    assert Associator(STRIPES).assign([red], [detect(red, 2.0)]) == {}


def test_the_appearance_counts_relative_to_the_mean_distance_of_the_track(tracks):
    red, blue, _ = tracks
    other = detect(red, 0.3, between(red.descriptor, blue.descriptor, 0.25))
    for mean, assigned in ((0.04, {}), (0.15, {0: 0})):
        track = replace(red, mean_appearance_distance=mean)
        assert Associator(STRIPES).assign([track], [other]) == assigned


@pytest.mark.parametrize(
    ("state", "is_selected", "assigned"),
    [
        ("tracking", True, {0: 0}),
        ("occluded", True, {}),
        ("lost", True, {}),
        ("occluded", False, {0: 0}),
    ],
)
def test_who_covers_the_selected_target_is_not_taken_for_it(tracks, state, is_selected, assigned):
    red, blue, _ = tracks
    estimate = replace(red.filter_state.estimate, state=state)
    track = replace(
        red,
        filter_state=replace(red.filter_state, estimate=estimate),
        is_selected=is_selected,
        mean_appearance_distance=0.15,
        others_distance=0.3,
    )
    # It is found again up to twice its mean distance.
    other = detect(red, 0.0, between(red.descriptor, blue.descriptor, 0.35))
    assert Associator(STRIPES).assign([track], [other]) == assigned
    same = detect(red, 0.0, between(red.descriptor, blue.descriptor, 0.25))
    assert Associator(STRIPES).assign([track], [same]) == {0: 0}


def test_the_mean_appearance_distance_is_learned_from_detections(tracks):
    red, blue, _ = tracks
    other = between(red.descriptor, blue.descriptor, 0.7)
    for second, low, high in ((red.descriptor, 0.0, 0.04), (other, 0.12, 1.0)):
        track = red
        for _ in range(40):
            track = track.update_descriptor(red.descriptor, STRIPES)
            track = track.update_descriptor(second, STRIPES)
        assert low < track.mean_appearance_distance < high


def test_detections_of_two_close_targets_are_assigned_by_appearance(tracks):
    red, blue, _ = tracks
    shift = 0.2 * red.box[2]
    box_filter = red.box_filter._replace(mean=red.box_filter.mean + [shift, 0.0, 0.0, 0.0])
    blue = replace(blue, filter_state=red.filter_state, box_filter=box_filter)
    both = [detect(red, 0.0, blue.descriptor), detect(red, 0.2)]
    assert Associator(STRIPES).assign([red, blue], both) == {0: 1, 1: 0}


# Switched ids


@pytest.fixture
def met(walkers, make_tracker):
    """Two tracks of the first frame, and detections of them next to each other."""
    tracker = make_tracker()
    boxes = walkers.boxes[0][:2].copy()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0, targets=[0, 1]))
    tracks = tracker._manager._track_set.tracks
    image = np.full_like(walkers.images[0], 120)
    positions = [(40, 60), (90, 60)]
    for (x, y), box in zip(positions, boxes.astype(int), strict=True):
        left, top, width, height = box
        patch = walkers.images[0][top : top + height, left : left + width]
        image[y : y + height, x : x + width] = patch
    near = boxes.copy()
    near[:, :2] = positions
    detections, _ = describe_detections(Detections(near), Frame(image), 0.0, STRIPES)
    detections.sort(key=lambda one: one.box[0])
    ordered = sorted(tracks, key=lambda track: abs(track.box[0] - boxes[0, 0]))
    return ordered, detections


def test_switched_tracks_exchange_identities_and_filters_stay(met):
    tracks, detections = met
    corrected = correct_id_switches(tracks, detections[::-1], STRIPES)
    assert [track.key for track in corrected] == [track.key for track in tracks[::-1]]
    assert [track.filter_state for track in corrected] == [track.filter_state for track in tracks]


def test_tracks_that_fit_their_detections_stay(met):
    tracks, detections = met
    assert correct_id_switches(tracks, detections, STRIPES) == tuple(tracks)


def test_nothing_is_exchanged_while_one_is_undetected_or_overlapped(met):
    tracks, detections = met
    overlapped = [detections[1], detections[0]._replace(is_clear=False)]
    assert correct_id_switches(tracks, overlapped, STRIPES) == tuple(tracks)
    assert correct_id_switches(tracks, [detections[1], None], STRIPES) == tuple(tracks)


def test_lookalikes_are_not_exchanged(met):
    tracks, detections = met
    alike = [replace(track, descriptor=detections[0].descriptor) for track in tracks]
    both = [detections[0], detections[1]._replace(descriptor=detections[0].descriptor)]
    assert correct_id_switches(alike, both[::-1], STRIPES) == tuple(alike)
