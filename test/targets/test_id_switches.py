from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import correct_id_switches
from pf_tracker_ros.targets.detections import describe_detections

INTERVAL = 0.1
STRIPES = ColorStripes()


@pytest.fixture
def met(walkers, make_tracker):
    """Two lives in the first frame, and what a detector sees of them in the next, brought near."""
    tracker = make_tracker()
    boxes = walkers.boxes[0][:2].copy()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0, targets=[0, 1]))
    tracks = tracker._manager._track_set.tracks
    image = np.full_like(walkers.images[0], 120)
    places = [(40, 60), (90, 60)]
    for (x, y), box in zip(places, boxes.astype(int), strict=True):
        left, top, width, height = box
        part = walkers.images[0][top : top + height, left : left + width]
        image[y : y + height, x : x + width] = part
    near = boxes.copy()
    near[:, :2] = places
    seen, _ = describe_detections(walkers.detections(0).__class__(near), Frame(image), 0.0, STRIPES)
    seen.sort(key=lambda one: one.box[0])
    ordered = sorted(tracks, key=lambda track: abs(track.box[0] - boxes[0, 0]))
    return ordered, seen


def test_who_came_out_as_the_other_is_exchanged_and_the_filters_go_on(met):
    tracks, seen = met
    settled = correct_id_switches(tracks, seen[::-1], STRIPES)
    assert [track.key for track in settled] == [track.key for track in tracks[::-1]]
    assert [track.filter_state for track in settled] == [track.filter_state for track in tracks]


def test_who_is_who_stays_so(met):
    tracks, seen = met
    assert correct_id_switches(tracks, seen, STRIPES) == tuple(tracks)


def test_nothing_is_exchanged_while_one_is_not_shown_alone(met):
    tracks, seen = met
    hidden = [seen[1], replace_clear(seen[0])]
    assert correct_id_switches(tracks, hidden, STRIPES) == tuple(tracks)
    assert correct_id_switches(tracks, [seen[1], None], STRIPES) == tuple(tracks)


def replace_clear(one):
    return one._replace(is_clear=False)


def test_lookalikes_are_not_exchanged(met):
    tracks, seen = met
    alike = [replace(track, descriptor=seen[0].descriptor) for track in tracks]
    both = [seen[0], seen[1]._replace(descriptor=seen[0].descriptor)]
    assert correct_id_switches(alike, both[::-1], STRIPES) == tuple(alike)
