"""The last frames, and what the targets were in them, for detections that come late."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.life import Life
from pf_tracker_ros.tracking.tracker import NOMINAL_INTERVAL

# How late a detection may be, in seconds.
REACH = 2.0
# Most frames, and most memory for their images, in bytes.
_MOST_FRAMES = 1000
_MOST_BYTES = 128e6


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame, and what is needed to work out again what it made of the targets.

    Attributes:
        frame: The image.
        interval: Seconds since the frame before.
        before: The targets as that left them.
        seen: What a detector found in it; None where it did not run.
        begun: Targets that were then asked for by hand.
        stopped: Targets that were then forgotten by hand, as they were.
    """

    frame: Frame
    interval: float
    before: Crowd
    seen: tuple[Sighting, ...] | None = None
    begun: tuple[Life, ...] = ()
    stopped: tuple[Life, ...] = ()


class History:
    """Moments in the order of time, bounded in seconds, in number and in memory.

    Attributes:
        seconds: From the oldest to the newest.
    """

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque()
        self.seconds = 0.0
        self._bytes = 0
        self._most_frames = _MOST_FRAMES
        self._most_bytes = _MOST_BYTES

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest moments beyond them are dropped, the newest never.

        Args:
            frames: Most frames that are kept.
            megabytes: Most memory that their images hold, in units of 10^6 bytes.
        """
        self._most_frames, self._most_bytes = frames, megabytes * 1e6
        self._trim()

    def emptied(self) -> History:
        """Another one with the same bounds, and without moments."""
        other = History()
        other.limit(self._most_frames, self._most_bytes / 1e6)
        return other

    def clear(self) -> None:
        """Forget all moments."""
        self.put(())

    def put(self, moments: Sequence[Moment]) -> None:
        """Keep these in the place of all, in the same order; none, or as many as there are."""
        self._moments = deque(moments)
        if not moments:
            self.seconds, self._bytes = 0.0, 0

    def __len__(self) -> int:
        return len(self._moments)

    def add(self, moment: Moment) -> None:
        """Keep a moment, the newest; the oldest beyond the bounds are dropped, this one never."""
        if self._moments:
            self.seconds += moment.interval
            # What was made of an image is as large again, and seldom asked for once more.
            self.last.frame.forget_what_was_made()
        self._moments.append(moment)
        self._bytes += moment.frame.image.nbytes
        self._trim()

    def _trim(self) -> None:
        while len(self._moments) > 1 and (
            self.seconds > REACH
            or self._bytes > self._most_bytes
            or len(self._moments) > self._most_frames
        ):
            dropped = self._moments.popleft()
            self.seconds -= self._moments[0].interval
            self._bytes -= dropped.frame.image.nbytes

    @property
    def moments(self) -> tuple[Moment, ...]:
        """All of them, the oldest first."""
        return tuple(self._moments)

    @property
    def is_whole(self) -> bool:
        """Whether it goes back to the first frame of all."""
        return len(self._moments) > 0 and self.first.before.frame == 0

    @property
    def first(self) -> Moment:
        """The oldest."""
        return self._moments[0]

    @property
    def last(self) -> Moment:
        """The newest."""
        return self._moments[-1]

    def since(self, age: float) -> list[Moment] | None:
        """The moments from the one nearest to an age on, the oldest first; None if all are younger.

        Args:
            age: Seconds before the newest.
        """
        back: list[Moment] = []
        since = 0.0
        for moment in reversed(self._moments):
            back.append(moment)
            if age <= since + moment.interval / 2:
                return back[::-1]
            since += moment.interval
        if self.is_whole and age <= since - self.first.interval + NOMINAL_INTERVAL / 2:
            # Before the first frame of all, there was none that could be nearer.
            return back[::-1]
        return None

    def revise(self, moments: Sequence[Moment]) -> None:
        """Put moments in the place of as many of the newest, whose frames they have."""
        for _ in moments:
            self._moments.pop()
        self._moments.extend(moments)
