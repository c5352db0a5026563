from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.targets.association import Associator
from pf_tracker_ros.targets.detections import Detection

INTERVAL = 0.1
STRIPES = ColorStripes()


@pytest.fixture
def tracks(walkers, make_tracker):
    tracker = make_tracker()
    tracker.update(walkers.images[0], INTERVAL, walkers.detections(0))
    return sorted(tracker._manager._track_set.tracks, key=lambda track: track.box[1])


def seen(track, shift=0.0, look=None):
    """A detection of it, or of one that looks otherwise, so many widths beside it."""
    box = track.box + np.array([shift * track.box[2], 0.0, 0.0, 0.0])
    return Detection(box, 0.95, "", track.descriptor if look is None else look)


def between(one, other, apart):
    """A look that differs from one by so much."""
    shares = np.linspace(0.0, 1.0, 400)
    looks = [STRIPES.blend(one, other, share) for share in shares]
    return min(looks, key=lambda look: abs(STRIPES.distance(one, look[None])[0] - apart))


def test_the_detection_of_a_neighbor_is_not_taken_where_its_own_is_missing(tracks):
    red, blue, _ = tracks
    assert Associator(STRIPES).assign([red], [seen(red, 0.7)]) == {0: 0}
    assert (
        Associator(STRIPES).assign(
            [red], [seen(red, 0.7, between(red.descriptor, blue.descriptor, 0.4))]
        )
        == {}
    )


def test_one_that_looks_the_same_is_another_where_it_is_too_far_away(tracks):
    red, _, _ = tracks
    assert Associator(STRIPES).assign([red], [seen(red, 1.5)]) == {0: 0}
    assert Associator(STRIPES).assign([red], [seen(red, 2.0)]) == {}


def test_a_look_counts_as_much_as_the_targets_own_are_alike(tracks):
    red, blue, _ = tracks
    other = seen(red, 0.3, between(red.descriptor, blue.descriptor, 0.25))
    assert Associator(STRIPES).assign([replace(red, mean_appearance_distance=0.04)], [other]) == {}
    assert Associator(STRIPES).assign([replace(red, mean_appearance_distance=0.15)], [other]) == {
        0: 0
    }


def test_how_much_a_target_varies_is_learned_of_its_detections(tracks):
    red, blue, _ = tracks
    steady, restless = red, red
    other = between(red.descriptor, blue.descriptor, 0.7)
    for _ in range(40):
        steady = steady.update_descriptor(red.descriptor, STRIPES).update_descriptor(
            red.descriptor, STRIPES
        )
        restless = restless.update_descriptor(red.descriptor, STRIPES).update_descriptor(
            other, STRIPES
        )
    assert steady.mean_appearance_distance < 0.04
    assert restless.mean_appearance_distance > 0.12


def test_two_that_stand_close_get_their_own_by_their_looks(tracks):
    red, blue, _ = tracks
    shift = 0.2 * red.box[2]
    center_filter = replace(red.center_filter, center=red.center_filter.center + [shift, 0.0])
    blue = replace(
        blue, filter_state=red.filter_state, center_filter=center_filter, log_size=red.log_size
    )
    both = [seen(red, 0.0, blue.descriptor), seen(red, 0.2)]
    assert Associator(STRIPES).assign([red, blue], both) == {0: 1, 1: 0}
