"""The last frames and the targets before each: what late detections and late targets are of."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.tracks import Crowd, Key, Life

# How long an operator may take to draw a target, with some reserve for the way there and back.
_REACH = NANOSECONDS * 11 // 5
# Of frames that are too many to be kept in full, the last one in each such time is kept.
_SPACING = NANOSECONDS // 10
# Share of the memory that these may take; what is left is for the newest frames.
_SHARE = 0.55


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """A frame that is kept in less memory.

    Attributes:
        stamp: When it was taken, in nanoseconds.
        pixels: The image, reduced.
        shape: Of the image before.
        reduction: Image pixels to one of the reduced ones along each axis.
        seen_as: What was known of the frame beside its image, see `Frame.with_image`.
    """

    stamp: int
    pixels: NDArray[Any]
    shape: tuple[int, ...]
    reduction: int
    seen_as: Frame

    @classmethod
    def of(cls, frame: Frame, reduction: int) -> ReducedFrame:
        """Reduce a frame; by a power of 2, halved again and again, which is fast."""
        pixels, shape = frame.image, frame.image.shape
        height, width = (length - length % reduction for length in shape[:2])
        pixels = pixels[:height, :width]
        for _ in range(reduction.bit_length() - 1):
            height, width = height // 2, width // 2
            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
        return cls(frame.stamp, pixels, shape, reduction, frame.with_image(np.empty((0, 0))))

    def restored(self) -> Frame:
        """The frame with an image of the size and kind of the one before, made anew."""
        height, width = (length * self.reduction for length in self.pixels.shape[:2])
        image = cv2.resize(self.pixels, (width, height), interpolation=cv2.INTER_LINEAR)
        below, beside = self.shape[0] - height, self.shape[1] - width
        if below or beside:
            image = cv2.copyMakeBorder(image, 0, below, 0, beside, cv2.BORDER_REPLICATE)
        return self.seen_as.with_image(image)


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame, and what is needed to work out again what it made of the targets.

    Attributes:
        kept: The frame, in full or reduced.
        interval: Seconds since the moment before.
        before: The targets as that left them.
        seen: What a detector found in it; None where it did not run.
        begun: Targets that were then asked for by hand.
        stopped: Targets that were then forgotten by hand, as they were.
    """

    kept: Frame | ReducedFrame
    interval: float
    before: Crowd
    seen: tuple[Sighting, ...] | None = None
    begun: tuple[Life, ...] = ()
    stopped: tuple[Life, ...] = ()

    def without(self, keys: Collection[Key]) -> Moment:
        """The same, where some of the targets before it had not been there."""
        lives = tuple(life for life in self.before.lives if life.key not in keys)
        return replace(self, before=replace(self.before, lives=lives))

    def without_targets(self) -> Moment:
        """The same, where nobody had been there, and nobody had said anything of it."""
        return Moment(self.kept, self.interval, replace(self.before, lives=(), gone=()))

    @property
    def frame(self) -> Frame:
        """The frame; made anew at each call where it is kept reduced."""
        return self.kept.restored() if isinstance(self.kept, ReducedFrame) else self.kept

    @property
    def stamp(self) -> int:
        """Of the frame, nanoseconds."""
        return self.kept.stamp

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the frame, pixels."""
        shape = self.kept.shape if isinstance(self.kept, ReducedFrame) else self.kept.image.shape
        return shape[1], shape[0]

    @property
    def is_told_of(self) -> bool:
        """Whether somebody has said something of it that must not be forgotten."""
        return self.seen is not None or bool(self.begun or self.stopped)

    def joined(self, dropped: Moment) -> Moment:
        """This moment as the one after what came before another one, which is dropped."""
        kept, motion = self.kept, dropped._seen_as.camera_motion
        if motion is not None:
            seen_as = self._seen_as.with_image(self._seen_as.image)
            since = seen_as.camera_motion
            seen_as.camera_motion = motion if since is None else since @ motion
            kept = replace(kept, seen_as=seen_as) if isinstance(kept, ReducedFrame) else seen_as
        interval = dropped.interval + self.interval
        return replace(self, kept=kept, interval=interval, before=dropped.before)

    @property
    def _seen_as(self) -> Frame:
        return self.kept.seen_as if isinstance(self.kept, ReducedFrame) else self.kept


class FrameBuffer:
    """Moments in the order of their stamps, bounded in number and in the bytes of their images.

    The newest are kept in full. Where memory does not suffice for those of about two seconds, older
    ones are thinned out to ten in a second, and reduced as far as that takes. A frame without a
    stamp (0) is not kept, because nobody could name it, and nothing before it is.

    Args:
        frames: Most frames that are kept, but the newest is always.
        megabytes: Most memory that their images hold, in units of 10^6 bytes.

    Attributes:
        dropped_until: Stamp of the last frame that was dropped for the bounds with all before it,
            or because those after it are of another size or kind; 0 if none was.
    """

    def __init__(self, frames: int = 1, megabytes: float = 0.0) -> None:
        self._full: deque[Moment] = deque()
        # All of them older than those in full.
        self._thinned: deque[Moment] = deque()
        self._bytes = 0
        self.dropped_until = 0
        self.limit(frames, megabytes)

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest frames beyond them are thinned out, or dropped."""
        self._most_frames, self._megabytes = frames, megabytes
        self._trim()

    def emptied(self) -> FrameBuffer:
        """Another one with the same bounds, and without moments."""
        return FrameBuffer(self._most_frames, self._megabytes)

    def add(self, moment: Moment) -> None:
        """Keep a moment, the newest.

        Those before are dropped if their frames are of another size or kind, or if time has gone
        back.
        """
        assert isinstance(moment.kept, Frame)
        stamp, image = moment.stamp, moment.kept.image
        if stamp == 0:
            self.clear()
            return
        if self._full:
            last = self.last.frame
            if stamp <= last.stamp:
                self.clear()
            elif (last.image.shape, last.image.dtype) != (image.shape, image.dtype):
                self.clear()
                self.dropped_until = last.stamp
            # What was made of an image is as large again, and seldom asked for once more.
            last.clear_cache()
        self._full.append(moment)
        self._bytes += _held_bytes(image)
        while self._thinned and stamp - self._thinned[0].stamp > _REACH:
            self._drop_oldest()
        self._trim()

    def __len__(self) -> int:
        return len(self._thinned) + len(self._full)

    @property
    def moments(self) -> list[Moment]:
        """All of them, the oldest first."""
        return [*self._thinned, *self._full]

    @property
    def stamps(self) -> list[int]:
        """The stamps of the frames that are kept."""
        return [moment.stamp for moment in self.moments]

    @property
    def first(self) -> Moment:
        """The oldest."""
        return (self._thinned or self._full)[0]

    @property
    def last(self) -> Moment:
        """The newest."""
        return self._full[-1]

    @property
    def is_whole(self) -> bool:
        """Whether it goes back to the first frame of all."""
        return len(self) > 0 and self.first.before.frame == 0

    def since(self, stamp: int) -> list[Moment]:
        """The moments from the one nearest to `stamp` on; none if all are before it."""
        moments = self.moments
        first = next((i for i, one in enumerate(moments) if one.stamp >= stamp), len(moments))
        if 0 < first < len(moments):
            before, after = stamp - moments[first - 1].stamp, moments[first].stamp - stamp
            first -= before < after
        return moments[first:]

    def clear(self) -> None:
        """Forget all frames."""
        self._full.clear()
        self._thinned.clear()
        self._bytes = 0
        self.dropped_until = 0

    def put(self, moments: Sequence[Moment]) -> None:
        """Keep these, in the same order, in the place of all; without any, all were dropped."""
        dropped_until = self.last.stamp if len(self) and not moments else self.dropped_until
        self.clear()
        self.dropped_until = dropped_until
        reduced = [i for i, one in enumerate(moments) if isinstance(one.kept, ReducedFrame)]
        thinned_out = reduced[-1] + 1 if reduced else 0
        self._thinned.extend(moments[:thinned_out])
        self._full.extend(moments[thinned_out:])
        self._bytes = sum(map(_bytes_of, moments))

    def revise(self, moments: Sequence[Moment]) -> None:
        """Put moments in the place of all from the first of their stamps on."""
        if moments:
            before = [one for one in self.moments if one.stamp < moments[0].stamp]
            self.put([*before, *moments])

    def _trim(self) -> None:
        while len(self) > max(self._most_frames, 1):
            self._drop_oldest()
        while self._bytes > self._megabytes * 1e6 and len(self) > 1:
            if len(self._full) > 1:
                self._thin_out()
            else:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        dropped = (self._thinned or self._full).popleft()
        self._bytes -= _bytes_of(dropped)
        self.dropped_until = dropped.stamp

    def _thin_out(self) -> None:
        """Keep the oldest frame in full only if it is the last of its time, and then reduced."""
        moment = self._full.popleft()
        self._bytes -= _bytes_of(moment)
        is_last = moment.stamp // _SPACING != self._full[0].stamp // _SPACING
        if is_last or (moment.is_told_of and self._thinned):
            reduction = self._reduction(moment.frame.image)
            if reduction > 1:
                moment = replace(moment, kept=ReducedFrame.of(moment.frame, reduction))
            self._thinned.append(moment)
            self._bytes += _bytes_of(moment)
        elif self._thinned:
            self._full[0] = self._full[0].joined(moment)
        else:
            self.dropped_until = moment.stamp

    def _reduction(self, image: NDArray[np.generic]) -> int:
        """The power of 2 by which frames are reduced so that all that are thinned out fit."""
        held, most = _held_bytes(image), self._megabytes * 1e6
        room = min(_SHARE * most, most - held)
        reduction = 1
        while held * (_REACH / _SPACING) > room * reduction**2:
            if 2 * reduction > min(image.shape[:2]):
                break
            reduction *= 2
        return reduction


def thinned(moments: Sequence[Moment], most: int) -> list[Moment]:
    """At most so many moments after the first one, spread evenly; the last one is kept.

    Those of which somebody has said something are kept as well.
    """
    steps = min(len(moments) - 1, most)
    kept = set(np.linspace(0, len(moments) - 1, steps + 1).round().astype(int).tolist())
    chosen: list[Moment] = []
    skipped: list[Moment] = []
    for place, moment in enumerate(moments):
        if place not in kept and not moment.is_told_of:
            skipped.append(moment)
            continue
        chosen.append(reduce(Moment.joined, reversed(skipped), moment))
        skipped = []
    return chosen


def _bytes_of(moment: Moment) -> int:
    kept = moment.kept
    return kept.pixels.nbytes if isinstance(kept, ReducedFrame) else _held_bytes(kept.image)


def _held_bytes(image: NDArray[np.generic]) -> int:
    """The memory that lives as long as the image: a view holds all of what it is a view of."""
    owner: Any = image
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return memoryview(owner).nbytes
