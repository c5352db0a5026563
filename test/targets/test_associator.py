from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.targets.association import Associator
from pf_tracker_ros.targets.detections import Sighting

INTERVAL = 0.1
STRIPES = ColorStripes()


@pytest.fixture
def lives(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    return sorted(tracker._manager._crowd.lives, key=lambda life: life.box[1])


def seen(life, shift=0.0, look=None):
    """A detection of it, or of one that looks otherwise, so many widths beside it."""
    box = life.box + np.array([shift * life.box[2], 0.0, 0.0, 0.0])
    return Sighting(box, 0.95, "", life.descriptor if look is None else look)


def between(one, other, apart):
    """A look that differs from one by so much."""
    shares = np.linspace(0.0, 1.0, 400)
    looks = [STRIPES.blend(one, other, share) for share in shares]
    return min(looks, key=lambda look: abs(STRIPES.distance(one, look[None])[0] - apart))


def test_the_detection_of_a_neighbor_is_not_taken_where_its_own_is_missing(lives):
    red, blue, _ = lives
    assert Associator(STRIPES).assign([red], [seen(red, 0.7)]) == {0: 0}
    assert (
        Associator(STRIPES).assign(
            [red], [seen(red, 0.7, between(red.descriptor, blue.descriptor, 0.4))]
        )
        == {}
    )


def test_one_that_looks_the_same_is_another_where_it_is_too_far_away(lives):
    red, _, _ = lives
    assert Associator(STRIPES).assign([red], [seen(red, 1.5)]) == {0: 0}
    assert Associator(STRIPES).assign([red], [seen(red, 2.0)]) == {}


def test_a_look_counts_as_much_as_the_targets_own_are_alike(lives):
    red, blue, _ = lives
    other = seen(red, 0.3, between(red.descriptor, blue.descriptor, 0.25))
    assert Associator(STRIPES).assign([replace(red, varies=0.04)], [other]) == {}
    assert Associator(STRIPES).assign([replace(red, varies=0.15)], [other]) == {0: 0}


def test_how_much_a_target_varies_is_learned_of_its_detections(lives):
    red, blue, _ = lives
    steady, restless = red, red
    other = between(red.descriptor, blue.descriptor, 0.7)
    for _ in range(40):
        steady = steady.viewed(red.descriptor, STRIPES).viewed(red.descriptor, STRIPES)
        restless = restless.viewed(red.descriptor, STRIPES).viewed(other, STRIPES)
    assert steady.varies < 0.04
    assert restless.varies > 0.12


def test_two_that_stand_close_get_their_own_by_their_looks(lives):
    red, blue, _ = lives
    shift = 0.2 * red.box[2]
    course = replace(red.course, center=red.course.center + [shift, 0.0])
    blue = replace(blue, target=red.target, course=course, log_size=red.log_size)
    both = [seen(red, 0.0, blue.descriptor), seen(red, 0.2)]
    assert Associator(STRIPES).assign([red, blue], both) == {0: 1, 1: 0}
