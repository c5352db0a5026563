import numpy as np
import pytest

from pf_tracker_ros.recordings.keyframes.joining import CHECK_JOINED_BELOW, Pass, join

COUNT = 11


def straight(shift=0.0, count=COUNT):
    """Boxes of 20 px that move by 2 px a frame, shifted in x."""
    boxes = np.full((count, 4), 20.0)
    boxes[:, 0] = 2.0 * np.arange(count) + shift
    return boxes


def made(boxes, confidence=0.9, state="tracking"):
    return Pass(np.array(boxes), np.full(len(boxes), confidence), [state] * len(boxes))


def test_passes_that_agree_are_met_exactly():
    joined = join(made(straight()), made(straight()))
    np.testing.assert_allclose(joined.boxes, straight(), atol=1e-12)
    np.testing.assert_array_equal(joined.overlaps, 1.0)
    assert joined.confidences == pytest.approx((1.0 + 0.9 + 0.9) / 3)


def test_drift_is_distributed_over_a_pass_and_that_of_the_size_in_proportion():
    # The forward pass gains 0.5 px a frame, or grows; the backward one is right.
    drifting = straight() + np.outer(np.arange(COUNT), (0.5, 0.0, 0.0, 0.0))
    grown = straight()
    grown[:, 2:] *= 1.05 ** np.arange(COUNT)[:, None]
    grown[:, :2] -= (grown[:, 2:] - 20.0) / 2
    for stray in (drifting, grown):
        joined = join(made(stray), made(straight()))
        np.testing.assert_allclose(joined.boxes, straight(), atol=1e-9)


@pytest.mark.parametrize("is_forward_lost", [True, False])
def test_a_pass_that_leaves_the_target_does_not_count_there(is_forward_lost):
    """It never gets back, so it does not meet the other keyframe."""
    stray = straight()
    gone = slice(6, COUNT) if is_forward_lost else slice(0, 5)
    stray[gone, 0] += 500.0
    passes = (stray, straight()) if is_forward_lost else (straight(), stray)
    joined = join(*map(made, passes))
    np.testing.assert_allclose(joined.boxes, straight(), atol=1e-9)
    np.testing.assert_array_equal(joined.confidences[gone], 0.0)


def test_the_keyframes_are_met_if_both_passes_leave_the_target():
    forward, backward = straight(), straight()
    forward[3:, 1] += 300.0
    backward[:8, 1] -= 300.0
    joined = join(made(forward, 0.5), made(backward, 0.5))
    np.testing.assert_array_equal(joined.boxes[[0, -1]], straight()[[0, -1]])
    assert (joined.confidences[1:-1] < CHECK_JOINED_BELOW).all()


def test_a_short_disagreement_goes_to_the_more_confident_pass():
    stray = straight()
    stray[4:6, 1] += 100.0
    uncertain, sure = made(stray, 0.3), made(straight(), 0.9)
    np.testing.assert_allclose(join(uncertain, sure).boxes, straight(), atol=1e-9)
    np.testing.assert_allclose(join(sure, uncertain).boxes, straight(), atol=1e-9)


def test_a_target_that_one_pass_sees_is_not_lost():
    lost, seen = made(straight(), state="lost"), made(straight(), state="occluded")
    assert {*join(lost, seen).states} == {"occluded"}
    assert {*join(lost, lost).states} == {"lost"}


def test_neighboring_keyframes_leave_nothing_to_join():
    joined = join(made(straight(count=2)), made(straight(count=2)))
    np.testing.assert_array_equal(joined.boxes, straight(count=2))
