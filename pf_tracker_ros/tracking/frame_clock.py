"""Order of the frames by their stamps, frozen images, and checks of other stamps.

1. A frame after the last one is "next"; one with the same stamp is a "duplicate".
2. An older frame is "late" if it is at most a second older.
3. Any other frame, and the tenth late one in a row, is a "jump": time went back, as when a bag
   starts again.
4. The stamp of a detection or target must belong to a frame of the current time: not to the time
   before a jump, and not to another clock.

5. Images are frozen if a camera driver repeats one of them under new stamps. The sensor noise makes
   any two images of a real camera differ, also of a still scene. So images that are equal to the
   bit for some time are not new ones. Generated scenes have no noise.

Stamps are in nanoseconds; 0 means unknown.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import LATE_WITHIN, NANOSECONDS

FrameOrder = Literal["next", "duplicate", "late", "jump"]

# Largest number of late frames in a row; one more is a jump, as of a recording of under a second.
_MAX_LATE = 9

# Stamps further than this from the last frame are from another clock.
_SAME_CLOCK_WITHIN = 60 * NANOSECONDS

# A detector is at most this much ahead of the images, or two images if that is more.
_AHEAD_WITHIN = NANOSECONDS // 2


@dataclass(frozen=True)
class TimePolicy:
    """Reaction to late frames and to time that jumps back.

    Attributes:
        on_jump: "keep" keeps the target, "restart" starts it again on its first box, "wait" stops
            it.
        late_within: Largest age of a late frame, nanoseconds.
    """

    on_jump: str = "keep"
    late_within: int = LATE_WITHIN


def is_due(stamp: int, frame_stamp: int) -> bool:
    """Whether a detection or target with a stamp can be applied in the current frame."""
    return frame_stamp == 0 or stamp <= frame_stamp


class _Jump(NamedTuple):
    """A jump of time: stamps of the last frame before it and of the first one after it.

    A detector may be ahead of the images by so many nanoseconds.
    """

    last: int
    first: int
    ahead: int

    def is_before(self, stamp: int, now: int) -> bool:
        """Whether a stamp ahead of the frames, the last of which is `now`, is from before the jump.

        It is of a frame before the jump, reported late, or of a future frame, reported early by at
        most `ahead`: the smaller of the two times decides. Once the frames reach `last`, every
        stamp is of the current time.
        """
        early, beyond = stamp - now, stamp - self.last
        if early <= 0 or now >= self.last or beyond > self.ahead:
            return False
        late = abs(beyond) + now - self.first
        return early > min(late, self.ahead)


class FrameClock:
    """Classifies frames by their stamps and checks the stamps of detections and targets.

    Attributes:
        last: Stamp of the last frame that was taken, 0 before the first.
        expects_jump: Whether the next frame, if it is not after the last one, is a jump. Requests
            since then belong to the time after it.
    """

    def __init__(self) -> None:
        self.last = 0
        # Stamp of the last frame that was taken or skipped.
        self._latest = 0
        self._late_in_a_row = 0
        self.expects_jump = False
        self._jump: _Jump | None = None
        self._interval = 0.0
        # Skipped frames have stamps after the first of these, up to and including the second.
        self._skipped = (0, 0)

    def classify(self, stamp: int, late_within: int, requested: Collection[int] = ()) -> FrameOrder:
        """Order of a frame relative to the last one; counts late frames.

        A late frame is at most `late_within` nanoseconds old. An older frame on which a target is
        requested is a jump; a request of 0 is of the next frame.
        """
        elapsed = stamp - self.last
        if 0 in (stamp, self.last) or elapsed > 0:
            return "next"
        if self.expects_jump:
            return "jump"
        if elapsed == 0:
            return "duplicate"
        self._late_in_a_row += 1
        is_late = elapsed >= -late_within and self._late_in_a_row <= _MAX_LATE
        return "late" if is_late and not {0, stamp}.intersection(requested) else "jump"

    def expect_jump(self) -> None:
        """Classify the next frame as a jump if it is not after the last one.

        For use while there is no target: a recording may be rewound by any time. Earlier frames and
        an earlier jump no longer matter.
        """
        self.expects_jump, self._jump = True, None
        self._skipped = (0, self.last)

    def since_last(self, stamp: int) -> float | None:
        """Seconds from the last frame that was taken to another one; None if unknown."""
        if 0 in (stamp, self.last):
            return None
        return (stamp - self.last) / NANOSECONDS

    def take(self, stamp: int, interval: float | None = None) -> None:
        """Make a frame the last one, an interval after the one before; None if unknown."""
        self.last = self._latest = stamp
        self._late_in_a_row, self.expects_jump = 0, False
        self._interval = interval or self._interval

    def skip(self, stamp: int) -> None:
        """Advance the time by a frame that is not tracked."""
        self._latest = stamp
        after, until = self._skipped
        self._skipped = (after if until >= self.last else self.last, stamp)

    def jump_back(self, stamp: int) -> float:
        """Set the time back to a frame, which is still to be taken.

        Returns:
            Seconds of the jump.
        """
        ahead = max(_AHEAD_WITHIN, round(2 * self._interval * NANOSECONDS))
        self._jump, self._skipped = _Jump(self.last, stamp, ahead), (0, 0)
        return (self.last - stamp) / NANOSECONDS

    def is_from_before_jump(self, stamp: int, now: int) -> bool:
        """Whether the stamp of a detection or target is from before the last jump.

        `now` is the stamp of the last frame, or of the first one after the jump.
        """
        jump = self._jump
        return jump is not None and 0 not in (stamp, now) and jump.is_before(stamp, now)

    def was_skipped(self, stamp: int) -> bool:
        """Whether a stamp is that of a skipped frame."""
        after, until = self._skipped
        return after < stamp <= until

    def check_ahead(self, stamp: int) -> None:
        """Check that a stamp is not too far after the last frame.

        Raises:
            ValueError: The stamp is from another clock, or from before the last jump.
        """
        ahead = stamp - self._latest
        if self.is_from_before_jump(stamp, self._latest):
            raise ValueError(
                f"its stamp is {ahead / NANOSECONDS:.3f} s after that of the last frame, from "
                "before time went back; allowed: the stamp of a frame since, or 0 for the next one"
            )
        if stamp and self._latest and ahead > _SAME_CLOCK_WITHIN:
            raise ValueError(
                f"its stamp is {ahead / NANOSECONDS:.0f} s after that of the last frame, from "
                "another clock; allowed: the stamp of a frame, or 0 for the next one"
            )

    def check_behind(self, stamp: int) -> None:
        """Check that the stamp of a detection is not too far before the last frame.

        Raises:
            ValueError: The stamp is from another clock.
        """
        behind = self._latest - stamp
        if stamp and self._latest and behind > _SAME_CLOCK_WITHIN:
            raise ValueError(
                f"its stamp is {behind / NANOSECONDS:.0f} s before that of the last frame, from "
                "another clock; allowed: the stamp of the detector's frame, or 0 for the next one"
            )


NOMINAL_INTERVAL = 0.04
"""Seconds between frames where the interval is unknown."""

DEFAULT_FROZEN_AFTER = 0.5
"""Seconds of equal images after which they are frozen."""

# Rows of the first comparison. Noise shows in them, so that few images are compared as a whole.
_ROWS = 8


class FrozenImages:
    """Measures for how long the images have been equal to the bit, by their stamps."""

    def __init__(self) -> None:
        self._image: NDArray[Any] | None = None
        self._stamp = 0
        self._seconds = 0.0

    def forget(self) -> None:
        """Start anew with the next image, as after a jump of time."""
        self._image = None

    def seconds_unchanged(self, frame: Frame) -> float:
        """Seconds from the first of the equal images to a frame, which must not change any more."""
        image, stamp = frame.image, frame.stamp
        if self._image is not None and _are_equal(self._image, image):
            is_stamped = 0 not in (stamp, self._stamp)
            elapsed = (stamp - self._stamp) / NANOSECONDS if is_stamped else NOMINAL_INTERVAL
            self._seconds += elapsed
        else:
            self._seconds = 0.0
        self._image, self._stamp = image, stamp
        return self._seconds


def _are_equal(one: NDArray[Any], other: NDArray[Any]) -> bool:
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    step = max(1, len(one) // _ROWS)
    return np.array_equal(one[::step], other[::step]) and np.array_equal(one, other)
