"""The track's state over time."""

from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds

THRESHOLDS = TrackThresholds(occluded_below=0.2, recovered_above=0.4, lost_after=1.0)


def states(confidences, interval=0.25):
    track, seen = TrackStatus(), []
    for confidence in confidences:
        track = track.advance(confidence, confidence, interval, THRESHOLDS)
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
    track, seen = TrackStatus(), []
    for similarity in (0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.9):
        track = track.advance(0.1, similarity, 0.25, THRESHOLDS)
        seen.append(track.state)
    assert seen == ["occluded"] * 6 + ["lost"] * 2 + ["occluded"]


def test_a_glimpse_of_a_lost_target_is_on_probation():
    """Without another it is lost again at once, with others it is tracked on probation."""
    glimpsed = TrackStatus("lost", 5.0).advance(0.1, 0.9, 0.25, THRESHOLDS)
    assert (glimpsed.state, glimpsed.time_since_seen) == ("occluded", 0.25)
    assert glimpsed.advance(0.1, 0.1, 0.25, THRESHOLDS).state == "lost"
    seen = glimpsed.advance(0.9, 0.9, 0.25, THRESHOLDS)
    assert seen.state == "tracking"
    assert not seen.is_settled


def test_a_target_that_was_lost_is_on_probation_for_two_seconds():
    """In them it is as lost as before if it is hidden again; after them it is occluded first."""
    for frames, then in ((4, "lost"), (8, "occluded")):
        track = TrackStatus("lost", 5.0)
        for _ in range(1 + frames):
            track = track.advance(0.9, 0.9, 0.25, THRESHOLDS)
            assert track.state == "tracking"
        assert track.is_settled == (then == "occluded")
        assert track.advance(0.0, 0.0, 0.25, THRESHOLDS).state == then


def test_a_target_that_was_hidden_for_a_moment_is_settled_at_once():
    track = TrackStatus("occluded", 0.5).advance(0.9, 0.9, 0.25, THRESHOLDS)
    assert track.is_settled


def test_a_track_that_followed_something_else_is_lost():
    track = TrackStatus(probation=1.0).as_lost(THRESHOLDS)
    assert (track.state, track.time_since_seen) == ("lost", THRESHOLDS.lost_after)


def test_a_lost_target_that_is_seen_again_is_tracked():
    assert states([0.0] * 4 + [0.9])[-1] == "tracking"


def test_a_threshold_of_zero_never_calls_it_occluded():
    thresholds = TrackThresholds(occluded_below=0.0)
    assert TrackStatus().advance(0.0, 0.0, 1.0, thresholds).state == "tracking"
