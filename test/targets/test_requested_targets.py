"""The outcome of a requested target, by the next frame: with a single target and with several.

The rules are the same for both.
"""

import pytest
from sessions import at

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.presets import preset_parameters

BEFORE_JUMP = "target refused: it was drawn on a frame from before time went back; draw it again"


class Feed:
    """A session for one target or for several, and frames of `walkers` for it."""

    def __init__(self, mode, walkers):
        if mode == "one":
            self.session = Session({**preset_parameters("li2007"), "particles": 20}, seed=1)
        else:
            self.session = Session(preset_parameters("default", 32), seed=1)
        self.session.frame_buffer.limit(frames=30, megabytes=10.0)
        self.walkers = walkers

    def show(self, number, stamp=None):
        image = self.walkers.images[number]
        return self.session.process(Frame(image, at(number) if stamp is None else stamp))

    def request_on(self, number, stamp, target=0):
        self.session.request(tuple(self.walkers.boxes[number][target]), stamp)

    @property
    def waits(self):
        return self.session.requested_stamp is not None


@pytest.fixture(params=["one", "several"])
def feed(request, walkers):
    return Feed(request.param, walkers)


@pytest.fixture(params=[False, True], ids=["idle", "following"])
def watching(request, feed):
    """After ten frames, without a target and with one."""
    feed.has_target = request.param
    for number in range(10, 20):
        if request.param and number == 10:
            feed.request_on(10, at(10), target=1)
        feed.show(number)
    return feed


# Stamp of the request, the next frame (its number, its stamp), and the outcome; "-" stands for
# "waiting" or, with a target, "tracked".
NEXT = (20, at(20))
DUPLICATE = (19, at(19))
LATE = (17, at(17))
JUMP = (20, at(-600))
CASES = {
    "next frame, next": (0, NEXT, "started"),
    "next frame, duplicate": (0, DUPLICATE, "started"),
    "next frame, late": (0, LATE, "started"),
    "next frame, jump": (0, JUMP, "started"),
    "past frame, next": (at(15), NEXT, "started"),
    "past frame, duplicate": (at(15), DUPLICATE, "started"),
    "past frame, late": (at(15), LATE, "late"),
    "past frame, jump": (at(15), JUMP, "refused"),
    "this frame, next": (at(20), NEXT, "started"),
    "this frame, duplicate": (at(19), DUPLICATE, "started"),
    "this frame, late": (at(17), LATE, "started"),
    "this frame, jump": (at(-600), JUMP, "started"),
    "frame to come, next": (at(22), NEXT, "-"),
    "frame to come, duplicate": (at(22), DUPLICATE, "duplicate"),
    "frame to come, late": (at(22), LATE, "late"),
    "frame to come, jump": (at(-599), JUMP, "-"),
}


@pytest.mark.parametrize("case", CASES)
def test_the_outcome_of_a_requested_target(watching, case):
    requested, (number, stamp), expected = CASES[case]
    watching.request_on(number, requested)
    outcome = watching.show(number, stamp)
    otherwise = "tracked" if watching.has_target else "waiting"
    assert outcome.frame == {"-": otherwise, "refused": otherwise}.get(expected, expected)
    assert outcome.refused == ((BEFORE_JUMP,) if expected == "refused" else ())
    assert watching.waits == (expected not in ("started", "refused"))
    is_jump = (number, stamp) == JUMP or case in ("next frame, late", "this frame, late")
    assert (outcome.jumped_back > 0) == is_jump
    if watching.waits:
        # The target starts with its frame, whatever came before.
        due = {"jump": at(-598), "next": at(22)}.get(case.split(", ")[1], at(22))
        assert watching.show(22, due).frame == "started"


def test_without_a_target_duplicate_and_late_frames_are_not_buffered(feed):
    for number in range(10, 20):
        feed.show(number)
    assert feed.show(3, at(19)).frame == "duplicate"
    assert feed.show(3, at(18)).frame == "late"
    feed.request_on(12, at(12))
    outcome = feed.show(20)
    assert (outcome.frame, outcome.jumped_back) == ("started", 0.0)


@pytest.mark.parametrize("back", [1, 5, 9])
def test_after_a_stop_any_jump_back_is_accepted(feed, back):
    feed.request_on(0, 0)
    for number in range(20):
        feed.show(number)
    feed.session.stop()
    first = 19 - back
    feed.request_on(first, at(first))
    outcome = feed.show(first)
    assert (outcome.frame, outcome.refused) == ("started", ())
    assert outcome.jumped_back == pytest.approx(back / 10)
    assert feed.show(first + 1).frame == "tracked"


@pytest.mark.parametrize("first", [12, 18, 19])
def test_after_a_stop_a_target_on_a_future_frame_waits_for_it(feed, first):
    for number in range(20):
        feed.show(number)
    for _ in range(2):
        feed.session.stop()
        feed.request_on(19, at(19))
        frames = [feed.show(number).frame for number in range(first, 20)]
        assert frames == ["waiting"] * (19 - first) + ["started"]
        # A jump back before its frame has arrived.
        feed.session.stop()
        feed.request_on(19, at(19))
        feed.show(12)


def test_after_a_stop_a_target_may_start_on_the_same_frame(feed):
    feed.request_on(0, 0)
    for number in range(3):
        feed.show(number)
    feed.session.stop()
    feed.request_on(2, at(2))
    assert feed.show(2).frame == "started"


@pytest.mark.parametrize("policy", ["keep", "restart", "wait"])
@pytest.mark.parametrize("length", [5, 20])
def test_a_looped_recording_starts_its_target_in_each_pass(feed, policy, length):
    feed.session.time_policy = TimePolicy(policy)
    for _ in range(3):
        feed.request_on(0, at(0))
        frames = [feed.show(number).frame for number in range(length)]
        assert frames == ["started"] + ["tracked"] * (length - 1)


def test_after_a_jump_no_earlier_frame_is_replayed(watching):
    """Only the frame of the jump, which is the nearest to the stamp."""
    watching.show(20, at(-600))
    watching.request_on(10, at(-598))
    outcome = watching.show(10, at(-595))
    assert (outcome.frame, outcome.refused, outcome.caught_up) == ("started", (), 1)
