"""Order of frames and checks of stamps, also after time jumped back."""

import pytest

from pf_tracker_ros.stamps import LATE_WITHIN
from pf_tracker_ros.tracking.frame_clock import FrameClock, is_due

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@pytest.fixture
def clock():
    """A clock after 30 s of frames at 10 Hz."""
    clock = FrameClock()
    for number in range(300):
        show(clock, number / 10)
    return clock


def at(seconds):
    return START + round(seconds * SECOND)


def show(clock, seconds):
    stamp = at(seconds)
    clock.take(stamp, clock.since_last(stamp))


def jump(clock, seconds):
    assert clock.classify(at(seconds), LATE_WITHIN) == "jump"
    went_back = clock.jump_back(at(seconds))
    clock.take(at(seconds), None)
    return went_back


def is_refused(clock, seconds):
    """Whether a stamp is refused as one from before the jump."""
    try:
        clock.check_ahead(at(seconds))
    except ValueError as error:
        return "from before time went back" in str(error)
    return False


@pytest.mark.parametrize(
    ("stamp", "frame_stamp", "due"), [(5, 5, True), (4, 5, True), (6, 5, False), (6, 0, True)]
)
def test_a_detection_is_due_with_its_frame_or_a_later_one(stamp, frame_stamp, due):
    assert is_due(stamp, frame_stamp) is due


def test_the_time_since_the_last_frame_is_known_where_both_stamps_are(clock):
    assert clock.since_last(at(30.4)) == 0.5
    assert clock.since_last(0) is None
    assert FrameClock().since_last(at(0)) is None


def test_before_a_jump_a_detector_may_be_ahead_by_much(clock):
    assert not is_refused(clock, 80)


def test_a_jump_returns_its_seconds(clock):
    assert jump(clock, 0) == 29.9


@pytest.mark.parametrize(
    ("seconds", "refused"),
    [(0, False), (0.4, False), (0.6, True), (29.9, True), (30.3, True), (30.5, False)],
)
def test_after_a_jump_a_stamp_is_refused_if_the_time_before_is_nearer(clock, seconds, refused):
    jump(clock, 0)
    assert is_refused(clock, seconds) is refused


@pytest.fixture
def slow():
    """A clock after ten frames at 0.5 Hz."""
    clock = FrameClock()
    for number in range(10):
        show(clock, 2 * number)
    return clock


def test_with_slow_images_a_detector_may_be_ahead_by_two_images(slow):
    jump(slow, 0)
    assert not is_refused(slow, 4)
    assert is_refused(slow, 4.1)


def test_each_frame_after_a_jump_makes_an_earlier_stamp_less_likely(slow):
    jump(slow, 15)
    # 1 s early is less than 2 s before the last frame before the jump, 2.5 s early is more.
    assert not is_refused(slow, 16)
    assert is_refused(slow, 17.5)
    assert is_refused(slow, 18)
    show(slow, 16)
    assert is_refused(slow, 18)
    show(slow, 17)
    assert not is_refused(slow, 18)


def test_once_the_old_time_is_reached_every_stamp_is_current(clock):
    jump(clock, 0)
    show(clock, 29.9)
    assert not is_refused(clock, 30.3)


def test_without_stamps_none_is_from_before_a_jump(clock):
    jump(clock, 0)
    clock.check_ahead(0)
    clock.take(0, None)
    assert not is_refused(clock, 29.9)


@pytest.mark.parametrize("check", [FrameClock.check_ahead, FrameClock.check_behind])
def test_each_check_refuses_another_clock_on_its_side_only(clock, check):
    ahead = 3600 if check is FrameClock.check_ahead else -3600
    with pytest.raises(ValueError, match=r"its stamp is 36\d\d s .* from another clock; allowed:"):
        check(clock, at(ahead + 29.9))
    check(clock, at(29.9 - ahead))
    check(clock, 0)
    check(FrameClock(), at(ahead))


def test_skipped_frames_are_those_since_the_last_one_taken(clock):
    clock.skip(at(30))
    clock.skip(at(31))
    assert [clock.was_skipped(at(seconds)) for seconds in (29.9, 30, 31, 31.1)] == [
        *(False, True, True, False)
    ]
    show(clock, 32)
    assert clock.was_skipped(at(30.5))
    jump(clock, 0)
    assert not clock.was_skipped(at(30.5))


def test_frames_before_an_expected_jump_count_as_skipped_also_after_a_pause(clock):
    clock.expect_jump()
    assert [clock.was_skipped(at(seconds)) for seconds in (1, 29, 30)] == [True, True, False]
    clock.skip(at(40))
    assert [clock.was_skipped(at(seconds)) for seconds in (29, 40, 41)] == [True, True, False]
    assert not clock.was_skipped(0)


def test_skipped_frames_advance_the_time_of_the_checks(clock):
    clock.skip(at(100))
    clock.check_ahead(at(159))
    clock.check_behind(at(41))
    with pytest.raises(ValueError, match="another clock"):
        clock.check_behind(at(39))
