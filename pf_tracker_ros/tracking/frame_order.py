"""Which frame comes next, by the stamps: what came late, twice, or after a jump of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pf_tracker_ros.stamps import NANOSECONDS

Place = Literal["next", "duplicate", "late", "jump"]

# A frame that is older than the last one by at most this came late; by more, time began anew, as
# when a bag starts again.
LATE_WITHIN = NANOSECONDS

# So many late frames in a row are no stragglers: a recording shorter than that begins again.
_MOST_LATE = 10

# Nothing is said of a frame that far ahead; a tool has stamped it with the wrong clock.
LONGEST_WAIT = 60 * NANOSECONDS


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


class FrameOrder:
    """Tells what a frame is by its stamp, in nanoseconds, 0 where it is unknown.

    Attributes:
        last: Stamp of the last frame that was taken, 0 before the first.
        seen: The same, or that of the last one since that was passed over.
    """

    def __init__(self) -> None:
        self.last = self.seen = 0
        self._late_in_a_row = 0

    def place(self, stamp: int, late_within: int) -> Place:
        """What a frame is; a late one is counted.

        Args:
            stamp: Of the frame.
            late_within: Nanoseconds that it may be older than the last one and only be late.
        """
        elapsed = stamp - self.last
        if 0 in (stamp, self.last) or elapsed > 0:
            return "next"
        if elapsed == 0:
            return "duplicate"
        self._late_in_a_row += 1
        stragglers = self._late_in_a_row < _MOST_LATE
        return "late" if elapsed >= -late_within and stragglers else "jump"

    def take(self, stamp: int) -> None:
        """Go on from a frame."""
        self.last = self.seen = stamp
        self._late_in_a_row = 0

    def pass_over(self, stamp: int) -> None:
        """Let the clock go on with a frame that nobody looks at."""
        self.seen = stamp

    def check_ahead(self, stamp: int) -> None:
        """Refuse what is said of a frame that cannot come.

        Raises:
            ValueError: The stamp is by another clock than those of the frames.
        """
        ahead = stamp - self.seen
        if stamp and self.seen and ahead > LONGEST_WAIT:
            raise ValueError(
                f"its stamp is {ahead / NANOSECONDS:.0f} s after that of the last frame, from "
                "another clock; allowed: the stamp of a frame, or 0 for the next one"
            )
