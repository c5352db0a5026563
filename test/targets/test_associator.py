from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.targets.association import Associator
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.updater import Updater

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


def assign(tracks, detections):
    """Index of a track to the number of its detection."""
    matches = Associator(STRIPES).assign(tracks, detections)
    return {index: match.number for index, match in matches.items()}


def between(one, other, distance):
    """A blend of two descriptors at a distance from the first one."""
    shares = np.linspace(0.0, 1.0, 400)
    blends = [STRIPES.blend(one, other, share) for share in shares]
    return min(blends, key=lambda blend: abs(STRIPES.distance(one, blend[None])[0] - distance))


def test_the_detection_of_a_neighbor_is_not_assigned_to_an_undetected_track(tracks):
    red, blue, _ = tracks
    assert assign([red], [detect(red, 0.7)]) == {0: 0}
    unlike = detect(red, 0.7, between(red.descriptor, blue.descriptor, 0.4))
    assert assign([red], [unlike]) == {}


def test_a_detection_beyond_the_gate_is_not_assigned_however_alike(tracks):
    red, _, _ = tracks
    assert assign([red], [detect(red, 1.5)]) == {0: 0}
    assert assign([red], [detect(red, 2.0)]) == {}


def test_the_appearance_counts_relative_to_the_mean_distance_of_the_track(tracks):
    red, blue, _ = tracks
    other = detect(red, 0.3, between(red.descriptor, blue.descriptor, 0.25))
    for mean, assigned in ((0.04, {}), (0.15, {0: 0})):
        track = replace(red, mean_appearance_distance=mean)
        assert assign([track], [other]) == assigned


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
    box_filter = replace(red.box_filter, mean=red.box_filter.mean + [shift, 0.0, 0.0, 0.0])
    blue = replace(blue, filter_state=red.filter_state, box_filter=box_filter)
    both = [detect(red, 0.0, blue.descriptor), detect(red, 0.2)]
    assert assign([red, blue], both) == {0: 1, 1: 0}


@pytest.mark.parametrize(
    ("cost", "interval", "age", "log_odds"),
    [
        (-4.0, 0.1, 0.2, 1.5),
        (-1.0, 0.1, 0.2, 0.7),
        (2.0, 0.1, 0.2, -0.8),
        (9.0, 0.1, 1.9, -1.3),
        (9.0, 0.1, 2.1, 1.5),
        (2.0, 0.5, 0.2, 1.5),
    ],
)
def test_detections_that_fit_badly_take_existence_log_odds_from_new_tracks_of_a_fast_detector(
    tracks, cost, interval, age, log_odds
):
    # Of two hits, the mean cost is half of the second one.
    track = replace(tracks[0], hits=2, age=age, existence_log_odds=0.2, association_cost=0.0)
    (track,) = Updater(None, 0.8, STRIPES).update_existence([track], {0: cost}, interval)
    assert track.existence_log_odds == pytest.approx(log_odds)
