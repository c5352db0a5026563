from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import tell_apart
from pf_tracker_ros.targets.detections import sightings

INTERVAL = 0.1
STRIPES = ColorStripes()


@pytest.fixture
def met(walkers, make_tracker):
    """Two lives in the first frame, and what a detector sees of them in the next, brought near."""
    tracker = make_tracker()
    boxes = walkers.boxes[0][:2].copy()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0, targets=[0, 1]))
    lives = tracker._manager._crowd.lives
    image = np.full_like(walkers.images[0], 120)
    places = [(40, 60), (90, 60)]
    for (x, y), box in zip(places, boxes.astype(int), strict=True):
        left, top, width, height = box
        part = walkers.images[0][top : top + height, left : left + width]
        image[y : y + height, x : x + width] = part
    near = boxes.copy()
    near[:, :2] = places
    seen, _ = sightings(walkers.detections(0).__class__(near), Frame(image), 0.0, STRIPES)
    seen.sort(key=lambda one: one.box[0])
    ordered = sorted(lives, key=lambda life: abs(life.box[0] - boxes[0, 0]))
    return ordered, seen


def test_who_came_out_as_the_other_is_exchanged_and_the_filters_go_on(met):
    lives, seen = met
    settled = tell_apart(lives, seen[::-1], STRIPES)
    assert [life.key for life in settled] == [life.key for life in lives[::-1]]
    assert [life.target for life in settled] == [life.target for life in lives]


def test_who_is_who_stays_so(met):
    lives, seen = met
    assert tell_apart(lives, seen, STRIPES) == tuple(lives)


def test_nothing_is_exchanged_while_one_is_not_shown_alone(met):
    lives, seen = met
    hidden = [seen[1], replace_clear(seen[0])]
    assert tell_apart(lives, hidden, STRIPES) == tuple(lives)
    assert tell_apart(lives, [seen[1], None], STRIPES) == tuple(lives)


def replace_clear(one):
    return one._replace(is_clear=False)


def test_lookalikes_are_not_exchanged(met):
    lives, seen = met
    alike = [replace(life, descriptor=seen[0].descriptor) for life in lives]
    both = [seen[0], seen[1]._replace(descriptor=seen[0].descriptor)]
    assert tell_apart(alike, both[::-1], STRIPES) == tuple(alike)
