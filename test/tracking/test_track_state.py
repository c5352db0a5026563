"""The track state over time."""

from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds

THRESHOLDS = TrackThresholds(wrong_box_cost=0.25, lost_after=1.0)


def states(confidences, interval=0.25):
    status, seen = TrackStatus(), []
    for confidence in confidences:
        status = status.advance(confidence, confidence, interval, THRESHOLDS)
        seen.append(status.state)
    return seen


def test_a_target_is_tracked_while_its_box_costs_less_than_none():
    """A box costs (1 - p) / 4 on average, none costs p: the same at p = 0.2."""
    assert states([0.19, 0.2, 0.3, 0.1]) == ["occluded", "tracking", "tracking", "occluded"]
    assert TrackThresholds(wrong_box_cost=4.0).tracked_above == 0.8


def test_lost_after_the_stated_time_out_of_sight():
    assert states([0.0] * 5) == ["occluded"] * 3 + ["lost"] * 2


def test_a_frame_with_the_target_restarts_the_time():
    assert states([0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0]) == (
        ["occluded"] * 3 + ["tracking"] + ["occluded"] * 3
    )


def test_a_similar_frame_restarts_the_time_before_the_confidence_has_risen():
    status, seen = TrackStatus(), []
    for similarity in (0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.9):
        status = status.advance(0.1, similarity, 0.25, THRESHOLDS)
        seen.append(status.state)
    assert seen == ["occluded"] * 6 + ["lost"] * 2 + ["occluded"]


def test_a_lost_target_that_is_seen_again_is_tracked():
    assert states([0.0] * 4 + [0.9])[-1] == "tracking"


def test_without_a_cost_the_target_is_never_occluded():
    thresholds = TrackThresholds(wrong_box_cost=0.0)
    assert TrackStatus().advance(0.0, 0.0, 1.0, thresholds).state == "tracking"


def test_the_times_out_of_sight_and_since_the_target_was_found_again():
    """What is similar in a frame restarts the time to be lost, and not the one out of sight."""
    status, times = TrackStatus(), []
    for confidence, similarity in ((0.9, 0.9), (0.0, 0.0), (0.0, 0.9), (0.9, 0.9), (0.9, 0.9)):
        status = status.advance(confidence, similarity, 0.25, THRESHOLDS)
        times.append((status.hidden_for, status.reacquired_for))
    assert times == [(0.0, None), (0.25, None), (0.5, None), (0.5, 0.0), (0.25, 0.25)]
    assert status.advance(0.0, 0.0, 0.25, THRESHOLDS).reacquired_for is None


def test_after_a_long_time_out_of_sight_more_counts_no_more():
    """A pause of an hour is no hour of debt."""
    hidden = TrackStatus().advance(0.0, 0.0, 3600.0, THRESHOLDS)
    assert hidden.hidden_for == 5.0
