"""What becomes of a target that somebody asks for, by the frame that comes: one target or several.

The rules are the same, so each case is asked of both.
"""

import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.presets import preset_parameters

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 10
BEFORE_JUMP = "target refused: it was drawn on a frame from before time went back; draw it again"


def at(number):
    return START + number * STEP


class Followed:
    """A session for one target or for several, and frames of `walkers` for it."""

    def __init__(self, kind, walkers):
        if kind == "one":
            self.session = Session({**preset_parameters("li2007"), "particles": 20}, seed=1)
        else:
            self.session = Session(preset_parameters("default", 32), seed=1)
        self.session.frame_buffer.limit(frames=30, megabytes=10.0)
        self.walkers = walkers

    def show(self, number, stamp=None):
        image = self.walkers.images[number]
        return self.session.process(Frame(image, at(number) if stamp is None else stamp))

    def ask(self, number, stamp, target=0):
        self.session.request(tuple(self.walkers.boxes[number][target]), stamp)

    @property
    def waits(self):
        return self.session.requested_stamp is not None


@pytest.fixture(params=["one", "several"])
def followed(request, walkers):
    return Followed(request.param, walkers)


@pytest.fixture(params=[False, True], ids=["idle", "following"])
def watching(request, followed):
    """After ten frames, without a target and with one."""
    followed.follows = request.param
    for number in range(10, 20):
        if request.param and number == 10:
            followed.ask(10, at(10), target=1)
        followed.show(number)
    return followed


# Number of the frame that the target was drawn on, the frame that comes (its number, its stamp),
# and what becomes of it: "-" stands for "waiting" or, with a target, "tracked".
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
def test_what_becomes_of_a_requested_target(watching, case):
    requested, (number, stamp), expected = CASES[case]
    watching.ask(number, requested)
    outcome = watching.show(number, stamp)
    otherwise = "tracked" if watching.follows else "waiting"
    assert outcome.frame == {"-": otherwise, "refused": otherwise}.get(expected, expected)
    assert outcome.refused == ((BEFORE_JUMP,) if expected == "refused" else ())
    assert watching.waits == (expected not in ("started", "refused"))
    is_jump = (number, stamp) == JUMP or case in ("next frame, late", "this frame, late")
    assert (outcome.jumped_back > 0) == is_jump
    if watching.waits:
        # Whatever came, the target starts as soon as its frame is there.
        due = {"jump": at(-598), "next": at(22)}.get(case.split(", ")[1], at(22))
        assert watching.show(22, due).frame == "started"


def test_without_a_target_a_frame_that_comes_twice_or_late_leaves_the_history_alone(followed):
    for number in range(10, 20):
        followed.show(number)
    assert followed.show(3, at(19)).frame == "duplicate"
    assert followed.show(3, at(18)).frame == "late"
    followed.ask(12, at(12))
    outcome = followed.show(20)
    assert (outcome.frame, outcome.jumped_back) == ("started", 0.0)


@pytest.mark.parametrize("back", [1, 5, 9])
def test_after_a_stop_one_may_go_back_by_however_little(followed, back):
    followed.ask(0, 0)
    for number in range(20):
        followed.show(number)
    followed.session.stop()
    first = 19 - back
    followed.ask(first, at(first))
    outcome = followed.show(first)
    assert (outcome.frame, outcome.refused) == ("started", ())
    assert outcome.jumped_back == pytest.approx(back / 10)
    assert followed.show(first + 1).frame == "tracked"


@pytest.mark.parametrize("first", [12, 18, 19])
def test_after_a_stop_a_target_drawn_on_a_frame_to_come_again_waits_for_it(followed, first):
    for number in range(20):
        followed.show(number)
    for _ in range(2):
        followed.session.stop()
        followed.ask(19, at(19))
        frames = [followed.show(number).frame for number in range(first, 20)]
        assert frames == ["waiting"] * (19 - first) + ["started"]
        # Gone back before its frame has come again.
        followed.session.stop()
        followed.ask(19, at(19))
        followed.show(12)


def test_the_same_frame_again_after_a_stop_is_one_to_start_on(followed):
    followed.ask(0, 0)
    for number in range(3):
        followed.show(number)
    followed.session.stop()
    followed.ask(2, at(2))
    assert followed.show(2).frame == "started"


@pytest.mark.parametrize("policy", ["keep", "restart", "wait"])
@pytest.mark.parametrize("length", [5, 20])
def test_a_recording_in_a_loop_that_names_its_target_starts_it_in_each_pass(
    followed, policy, length
):
    followed.session.time_policy = TimePolicy(policy)
    for _ in range(3):
        followed.ask(0, at(0))
        frames = [followed.show(number).frame for number in range(length)]
        assert frames == ["started"] + ["tracked"] * (length - 1)


def test_after_a_jump_no_frame_of_the_old_time_is_caught_up(watching):
    """Only the one with which the new time began, which is the nearest to the stamp."""
    watching.show(20, at(-600))
    watching.ask(10, at(-598))
    outcome = watching.show(10, at(-595))
    assert (outcome.frame, outcome.refused, outcome.caught_up) == ("started", (), 1)
