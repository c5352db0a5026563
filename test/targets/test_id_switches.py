from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import correct_id_switches
from pf_tracker_ros.targets.detections import Detections, describe_detections

INTERVAL = 0.1
STRIPES = ColorStripes()


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
