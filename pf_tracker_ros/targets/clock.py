"""The time of the frames: which comes next, and which can be told of, also after time jumped back.

Stamps are in nanoseconds; 0 means unknown.
"""

from __future__ import annotations

from typing import NamedTuple

from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.frame_order import LONGEST_WAIT, FrameOrder, Place

# A detector is ahead of the images by at most that many nanoseconds, or two images if that is more.
_AHEAD_WITHIN = NANOSECONDS // 2


def is_due(said_of: int, stamp: int) -> bool:
    """Whether what was said of a frame counts with the one at hand.

    Args:
        said_of: Stamp of the frame that it was said of.
        stamp: Of the frame at hand.
    """
    return stamp == 0 or said_of <= stamp


def age_of(said_of: int, stamp: int) -> float:
    """Seconds from the frame that something was said of to the one at hand; 0 where unknown.

    Args:
        said_of: Stamp of the frame that it was said of.
        stamp: Of the frame at hand.
    """
    return 0.0 if 0 in (said_of, stamp) else (stamp - said_of) / NANOSECONDS


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


class Clock:
    """Tells what a frame is by its stamp, and whether one can come that something is said of."""

    def __init__(self) -> None:
        self._order = FrameOrder()
        self._jump: _Jump | None = None
        self._interval = 0.0
        # Stamps between which no frame was looked at, up to and with the later one.
        self._passed = (0, 0)

    def place(self, stamp: int, late_within: int) -> Place:
        """What a frame is; see `FrameOrder.place`."""
        return self._order.place(stamp, late_within)

    def since_last(self, stamp: int) -> float | None:
        """Seconds from the last frame that was taken to another; None where nobody knows."""
        if 0 in (stamp, self._order.last):
            return None
        return (stamp - self._order.last) / NANOSECONDS

    def take(self, stamp: int, interval: float | None) -> None:
        """Go on from a frame.

        Args:
            stamp: Of the frame.
            interval: Seconds since the one before, None where nobody knows.
        """
        self._order.take(stamp)
        self._interval = interval or self._interval

    def pass_over(self, stamp: int) -> None:
        """Let time go on with a frame that nobody looks at."""
        self._order.pass_over(stamp)
        self._passed = (self._order.last, stamp)

    def jump_back(self, stamp: int) -> float:
        """Let time begin anew with a frame, which is still to be taken.

        Returns:
            Seconds by which it went back.
        """
        ahead = max(_AHEAD_WITHIN, round(2 * self._interval * NANOSECONDS))
        self._jump, self._passed = _Jump(self._order.last, stamp, ahead), (0, 0)
        return (self._order.last - stamp) / NANOSECONDS

    def was_passed_over(self, stamp: int) -> bool:
        """Whether the frame of a stamp is one of the last that nobody looked at."""
        after, until = self._passed
        return after < stamp <= until

    def check_ahead(self, stamp: int) -> None:
        """Refuse what is said of a frame that cannot come.

        Raises:
            ValueError: The stamp is by another clock than those of the frames, or of a frame from
                before time went back.
        """
        now = self._order.seen
        if self._jump and 0 not in (stamp, now) and self._jump.is_before(stamp, now):
            raise ValueError(
                f"its stamp is {(stamp - now) / NANOSECONDS:.3f} s after that of the last frame, "
                "of a frame from before time went back; allowed: the stamp of a frame since, or 0 "
                "for the next one"
            )
        self._order.check_ahead(stamp)

    def check_behind(self, stamp: int) -> None:
        """Refuse what a detector says of a frame so long ago that it is by another clock.

        Raises:
            ValueError: It is.
        """
        behind = self._order.seen - stamp
        if stamp and self._order.seen and behind > LONGEST_WAIT:
            raise ValueError(
                f"its stamp is {behind / NANOSECONDS:.0f} s before that of the last frame, from "
                "another clock; allowed: the stamp of the frame that the detector saw, or 0 for "
                "the next one"
            )
