"""The track's state over time."""

import pytest

from pf_tracker_ros.tracking.track_state import Track, TrackParameters

PARAMETERS = TrackParameters(occluded_below=0.2, recovered_above=0.4, lost_after=1.0)


def states(confidences, interval=0.25):
    track, seen = Track(), []
    for confidence in confidences:
        track = track.after(confidence, confidence, interval, PARAMETERS)
        seen.append(track.state)
    return seen


def test_occluded_below_the_threshold_and_back_only_above_the_higher_one():
    assert states([0.3, 0.1, 0.3, 0.5, 0.3]) == [
        "tracking",
        "occluded",
        "occluded",
        "tracking",
        "tracking",
    ]


def test_lost_after_the_stated_time_out_of_sight():
    assert states([0.0] * 5) == ["occluded"] * 3 + ["lost"] * 2


def test_a_glimpse_of_the_target_starts_the_clock_again():
    assert states([0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0]) == (
        ["occluded"] * 3 + ["tracking"] + ["occluded"] * 3
    )


def test_a_glimpse_starts_the_clock_again_before_the_confidence_has_risen():
    track, seen = Track(), []
    for similarity in (0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.9):
        track = track.after(0.1, similarity, 0.25, PARAMETERS)
        seen.append(track.state)
    assert seen == ["occluded"] * 6 + ["lost"] * 2 + ["occluded"]


def test_a_lost_target_that_is_seen_again_is_tracked():
    assert states([0.0] * 4 + [0.9])[-1] == "tracking"


def test_a_threshold_of_zero_never_calls_it_occluded():
    parameters = TrackParameters(occluded_below=0.0)
    assert Track().after(0.0, 0.0, 1.0, parameters).state == "tracking"


def test_the_confidence_falls_at_once_and_rises_by_its_share_of_each_frame():
    parameters = TrackParameters(confidence_rate=0.25)
    confidence, told = 1.0, []
    for similarity in (0.2, 1.0, 1.0, 0.5, 0.9):
        confidence = parameters.confidence(confidence, similarity)
        told.append(confidence)
    assert told == pytest.approx([0.2, 0.4, 0.55, 0.5, 0.6])


def test_by_default_the_confidence_is_what_the_frame_says():
    assert [TrackParameters().confidence(0.3, similarity) for similarity in (0.1, 0.3, 0.7)] == [
        0.1,
        0.3,
        0.7,
    ]
