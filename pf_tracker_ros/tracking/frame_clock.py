"""The time of the frames: which comes next, late, twice or after a jump, and which can be told of.

Stamps are in nanoseconds; 0 means unknown.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pf_tracker_ros.stamps import NANOSECONDS

FrameOrder = Literal["next", "duplicate", "late", "jump"]

# A frame that is older than the last one by at most this came late; by more, time began anew, as
# when a bag starts again.
LATE_WITHIN = NANOSECONDS

# So many late frames in a row are no stragglers: a recording shorter than that begins again.
_MOST_LATE = 10

# Nothing is said of a frame that far ahead; a tool has stamped it with the wrong clock.
_LONGEST_WAIT = 60 * NANOSECONDS

# A detector is ahead of the images by at most that many nanoseconds, or two images if that is more.
_AHEAD_WITHIN = NANOSECONDS // 2


@dataclass(frozen=True)
class TimePolicy:
    """What to do when time jumps back.

    Attributes:
        on_jump: "keep" goes on with the target as it is, "restart" starts again on the box that
            the target was first drawn with, "wait" forgets the target.
        late_within: Nanoseconds that a frame may be older than the last one and only be late.
    """

    on_jump: str = "keep"
    late_within: int = LATE_WITHIN


def is_due(said_of: int, stamp: int) -> bool:
    """Whether what was said of a frame counts with the one at hand.

    Args:
        said_of: Stamp of the frame that it was said of.
        stamp: Of the frame at hand.
    """
    return stamp == 0 or said_of <= stamp


class _Jump(NamedTuple):
    """Time that went back.

    Attributes:
        last: Stamp of the last frame before.
        first: Stamp of the first frame since.
        ahead: Nanoseconds by which a detector may be ahead of the images.
    """

    last: int
    first: int
    ahead: int

    def is_before(self, stamp: int, now: int) -> bool:
        """Whether a frame that has not come is rather one from before time went back.

        Until the old time is reached, a stamp ahead is of a frame of then, told late, or of one to
        come, told early; whichever is less is meant, and nothing is told that early.

        Args:
            stamp: Of the frame.
            now: Stamp of the last frame that came.
        """
        early, beyond = stamp - now, stamp - self.last
        if early <= 0 or now >= self.last or beyond > self.ahead:
            return False
        late = abs(beyond) + now - self.first
        return early > min(late, self.ahead)


class FrameClock:
    """Tells what a frame is by its stamp, and whether one can come that something is said of.

    Attributes:
        last: Stamp of the last frame that was taken, 0 before the first.
        expects_jump: Whether a next frame that is not after the last one is the first after a jump;
            what is asked for since then is of the time to come.
    """

    def __init__(self) -> None:
        self.last = 0
        # As `last`, or that of the last frame since that was passed over.
        self._seen = 0
        self._late_in_a_row = 0
        self.expects_jump = False
        self._jump: _Jump | None = None
        self._interval = 0.0
        # Stamps between which no frame counts any more, up to and with the later one: none was
        # looked at, or what was found in them was to be forgotten.
        self._passed = (0, 0)

    def classify(self, stamp: int, late_within: int, requested: Collection[int] = ()) -> FrameOrder:
        """What a frame is; a late one is counted.

        Args:
            stamp: Of the frame.
            late_within: Nanoseconds that it may be older than the last one and only be late.
            requested: Stamps of the frames that targets are to start on, 0 for the next one. Such a
                frame is none that is late: time has begun anew with it.
        """
        elapsed = stamp - self.last
        if 0 in (stamp, self.last) or elapsed > 0:
            return "next"
        if self.expects_jump:
            return "jump"
        if elapsed == 0:
            return "duplicate"
        self._late_in_a_row += 1
        is_late = elapsed >= -late_within and self._late_in_a_row < _MOST_LATE
        return "late" if is_late and not {0, stamp}.intersection(requested) else "jump"

    def expect_jump(self) -> None:
        """Take a next frame that is not after the last one for the first after a jump.

        Where nothing is followed, somebody may have gone back in a recording, by however little,
        and what came before an earlier jump is long forgotten.
        """
        self.expects_jump, self._jump = True, None
        self._passed = (0, self.last)

    def since_last(self, stamp: int) -> float | None:
        """Seconds from the last frame that was taken to another; None where nobody knows."""
        if 0 in (stamp, self.last):
            return None
        return (stamp - self.last) / NANOSECONDS

    def take(self, stamp: int, interval: float | None = None) -> None:
        """Go on from a frame.

        Args:
            stamp: Of the frame.
            interval: Seconds since the one before, None where nobody knows.
        """
        self.last = self._seen = stamp
        self._late_in_a_row, self.expects_jump = 0, False
        self._interval = interval or self._interval

    def skip(self, stamp: int) -> None:
        """Let time go on with a frame that nobody looks at."""
        self._seen = stamp
        after, until = self._passed
        self._passed = (after if until >= self.last else self.last, stamp)

    def jump_back(self, stamp: int) -> float:
        """Let time begin anew with a frame, which is still to be taken.

        Returns:
            Seconds by which it went back.
        """
        ahead = max(_AHEAD_WITHIN, round(2 * self._interval * NANOSECONDS))
        self._jump, self._passed = _Jump(self.last, stamp, ahead), (0, 0)
        return (self.last - stamp) / NANOSECONDS

    def is_from_before_jump(self, stamp: int, now: int) -> bool:
        """Whether what was said of a frame is rather said of one from before time went back.

        Args:
            stamp: Of the frame.
            now: Stamp of the last frame that came, or of the one with which time begins anew.
        """
        jump = self._jump
        return jump is not None and 0 not in (stamp, now) and jump.is_before(stamp, now)

    def was_skipped(self, stamp: int) -> bool:
        """Whether the frame of a stamp is one of the last that count no more."""
        after, until = self._passed
        return after < stamp <= until

    def check_ahead(self, stamp: int) -> None:
        """Refuse what is said of a frame that cannot come.

        Raises:
            ValueError: The stamp is by another clock than those of the frames, or of a frame from
                before time went back.
        """
        ahead = stamp - self._seen
        if self.is_from_before_jump(stamp, self._seen):
            raise ValueError(
                f"its stamp is {ahead / NANOSECONDS:.3f} s after that of the last frame, of a "
                "frame from before time went back; allowed: the stamp of a frame since, or 0 for "
                "the next one"
            )
        if stamp and self._seen and ahead > _LONGEST_WAIT:
            raise ValueError(
                f"its stamp is {ahead / NANOSECONDS:.0f} s after that of the last frame, from "
                "another clock; allowed: the stamp of a frame, or 0 for the next one"
            )

    def check_behind(self, stamp: int) -> None:
        """Refuse what a detector says of a frame so long ago that it is by another clock.

        Raises:
            ValueError: It is.
        """
        behind = self._seen - stamp
        if stamp and self._seen and behind > _LONGEST_WAIT:
            raise ValueError(
                f"its stamp is {behind / NANOSECONDS:.0f} s before that of the last frame, from "
                "another clock; allowed: the stamp of the frame that the detector saw, or 0 for "
                "the next one"
            )
