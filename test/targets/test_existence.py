"""Log odds of existence, by hits and misses of a detector."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.targets.association import Association
from pf_tracker_ros.targets.existence import update_existence
from pf_tracker_ros.targets.tracks import HitCost, TrackSet

RECALL = 0.8
# The mean excess of a track with two hits is half of the initial 2 and half of the second one's.
YOUNG = {"hits": 2, "age": 0.2, "existence_log_odds": 0.2}


LEARNED = HitCost(-1.5, 300)


def updated(track, associations, hit_cost=LEARNED, interval=0.1):
    """The track after a frame with detections."""
    scene = TrackSet(tracks=(track,), detection_interval=interval, hit_cost=hit_cost)
    (track,) = update_existence(scene, associations, RECALL).tracks
    return track


@pytest.mark.parametrize(
    ("excess", "situation", "log_odds"),
    [
        (-2.0, (0.1, 0.2, True), 1.5),
        (0.0, (0.1, 0.2, True), 1.2),
        (2.0, (0.1, 0.2, True), 0.2),
        (9.0, (0.1, 1.9, True), -1.3),
        (9.0, (0.1, 1.9, False), 1.5),
        (9.0, (0.1, 2.1, True), 1.5),
        (9.0, (0.2, 0.2, True), 1.5),
    ],
)
def test_a_contested_hit_of_a_new_track_adds_less_by_what_it_costs_more(
    tracks, excess, situation, log_odds
):
    interval, age, is_contested = situation
    track = replace(tracks[0], **YOUNG | {"age": age})
    hit = {0: Association(0, -1.5 + excess, is_contested)}
    assert updated(track, hit, interval=interval).existence_log_odds == pytest.approx(log_odds)


def test_manual_targets_and_distractors_are_exempt(tracks):
    red, blue, _ = tracks
    hit = {0: Association(0, 9.0, is_contested=True)}
    for track in (
        replace(red, **YOUNG, key=red.key._replace(number=-1)),
        replace(red, **YOUNG, distracted_key=blue.key),
    ):
        assert updated(track, hit).existence_log_odds == 1.5


@pytest.mark.parametrize(("interval", "share"), [(0.3, 1.0 - np.exp(-1.0)), (30.0, 1.0)])
def test_a_miss_takes_the_log_of_one_minus_the_recall_less_after_a_short_interval(
    tracks, interval, share
):
    track = replace(tracks[0], existence_log_odds=1.0)
    expected = 1.0 + share * np.log(0.2)
    assert updated(track, {}, interval=interval).existence_log_odds == pytest.approx(expected)


@pytest.mark.parametrize("hit_cost", [HitCost(), HitCost(-9.0, 19)])
def test_before_twenty_hits_the_initial_excess_alone_counts(tracks, hit_cost):
    track = replace(tracks[0], **YOUNG)
    hit = {0: Association(0, 9.0, is_contested=True)}
    # Half of the initial excess is left.
    assert updated(track, hit, hit_cost).existence_log_odds == pytest.approx(0.2 + 2.0 - 1.0)


def test_a_detector_that_is_imprecise_for_all_targets_ends_none(tracks):
    imprecise = precise = HitCost()
    for _ in range(10):
        imprecise = imprecise.learn([4.0, 5.0, 3.0])
        precise = precise.learn([-2.0, -3.0, -1.0])
    track = replace(tracks[0], **YOUNG)
    hit = {0: Association(0, 4.0, is_contested=True)}
    assert updated(track, hit, imprecise).existence_log_odds > 1.0
    assert updated(track, hit, precise).existence_log_odds < 0.0


def test_the_cost_of_a_hit_is_a_mean_without_outliers_of_targets_that_a_detector_started(tracks):
    assert HitCost().learn([3.0, 5.0, 1.0]) == (pytest.approx(3.0 + 1.0 / 2 - 1.0 / 3), 3)
    assert HitCost(-5.0, 300).typical == -2.0
    assert HitCost(1.0, 300).learn([1.5]) == (pytest.approx(1.0 + 0.5 / 300), 300)
    red, blue, _ = tracks
    manual = replace(blue, key=blue.key._replace(number=-1))
    scene = TrackSet(tracks=(red, manual), detection_interval=0.1)
    both = {0: Association(0, 1.0), 1: Association(1, 9.0)}
    assert update_existence(scene, both, RECALL).hit_cost == (1.0, 1)
