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
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track, TrackKey, TrackSet

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
        frame_info: What was known of the frame beside its image, see `Frame.with_image`.
    """

    stamp: int
    pixels: NDArray[Any]
    shape: tuple[int, ...]
    reduction: int
    frame_info: Frame

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
        return self.frame_info.with_image(image)


@dataclass(frozen=True, eq=False)
class HistoryEntry:
    """A frame, and what is needed to work out again what it made of the targets.

    Attributes:
        stored_frame: The frame, in full or reduced.
        interval: Seconds since the moment before.
        tracks_before: The targets as that left them.
        detections: What a detector found in it; None where it did not run.
        started: Targets that were then asked for by hand.
        stopped: Targets that were then forgotten by hand, as they were.
    """

    stored_frame: Frame | ReducedFrame
    interval: float
    tracks_before: TrackSet
    detections: tuple[Detection, ...] | None = None
    started: tuple[Track, ...] = ()
    stopped: tuple[Track, ...] = ()

    def without(self, keys: Collection[TrackKey]) -> HistoryEntry:
        """The same, where some of the targets before it had not been there."""
        tracks = tuple(track for track in self.tracks_before.tracks if track.key not in keys)
        return replace(self, tracks_before=replace(self.tracks_before, tracks=tracks))

    def without_targets(self) -> HistoryEntry:
        """The same, where nobody had been there, and nobody had said anything of it."""
        return HistoryEntry(
            self.stored_frame,
            self.interval,
            replace(self.tracks_before, tracks=(), ended_tracks=()),
        )

    @property
    def frame(self) -> Frame:
        """The frame; made anew at each call where it is kept reduced."""
        return (
            self.stored_frame.restored()
            if isinstance(self.stored_frame, ReducedFrame)
            else self.stored_frame
        )

    @property
    def stamp(self) -> int:
        """Of the frame, nanoseconds."""
        return self.stored_frame.stamp

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the frame, pixels."""
        shape = (
            self.stored_frame.shape
            if isinstance(self.stored_frame, ReducedFrame)
            else self.stored_frame.image.shape
        )
        return shape[1], shape[0]

    @property
    def has_input(self) -> bool:
        """Whether somebody has said something of it that must not be forgotten."""
        return self.detections is not None or bool(self.started or self.stopped)

    def merge_dropped(self, dropped: HistoryEntry) -> HistoryEntry:
        """This moment as the one after what came before another one, which is dropped."""
        kept, motion = self.stored_frame, dropped._seen_as.camera_motion
        if motion is not None:
            frame_info = self._seen_as.with_image(self._seen_as.image)
            since = frame_info.camera_motion
            frame_info.camera_motion = motion if since is None else since @ motion
            kept = (
                replace(kept, frame_info=frame_info)
                if isinstance(kept, ReducedFrame)
                else frame_info
            )
        interval = dropped.interval + self.interval
        return replace(
            self, stored_frame=kept, interval=interval, tracks_before=dropped.tracks_before
        )

    @property
    def _seen_as(self) -> Frame:
        return (
            self.stored_frame.frame_info
            if isinstance(self.stored_frame, ReducedFrame)
            else self.stored_frame
        )


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
        self._full: deque[HistoryEntry] = deque()
        # All of them older than those in full.
        self._thinned: deque[HistoryEntry] = deque()
        self._bytes = 0
        self.dropped_until = 0
        self.limit(frames, megabytes)

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest frames beyond them are thinned out, or dropped."""
        self._most_frames, self._megabytes = frames, megabytes
        self._trim()

    def empty_copy(self) -> FrameBuffer:
        """Another one with the same bounds, and without moments."""
        return FrameBuffer(self._most_frames, self._megabytes)

    def add(self, entry: HistoryEntry) -> None:
        """Keep a moment, the newest.

        Those before are dropped if their frames are of another size or kind, or if time has gone
        back.
        """
        assert isinstance(entry.stored_frame, Frame)
        stamp, image = entry.stamp, entry.stored_frame.image
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
        self._full.append(entry)
        self._bytes += _held_bytes(image)
        while self._thinned and stamp - self._thinned[0].stamp > _REACH:
            self._drop_oldest()
        self._trim()

    def __len__(self) -> int:
        return len(self._thinned) + len(self._full)

    @property
    def entries(self) -> list[HistoryEntry]:
        """All of them, the oldest first."""
        return [*self._thinned, *self._full]

    @property
    def stamps(self) -> list[int]:
        """The stamps of the frames that are kept."""
        return [entry.stamp for entry in self.entries]

    @property
    def first(self) -> HistoryEntry:
        """The oldest."""
        return (self._thinned or self._full)[0]

    @property
    def last(self) -> HistoryEntry:
        """The newest."""
        return self._full[-1]

    @property
    def is_complete(self) -> bool:
        """Whether it goes back to the first frame of all."""
        return len(self) > 0 and self.first.tracks_before.frame == 0

    def since(self, stamp: int) -> list[HistoryEntry]:
        """The moments from the one nearest to `stamp` on; none if all are before it."""
        entries = self.entries
        first = next((i for i, one in enumerate(entries) if one.stamp >= stamp), len(entries))
        if 0 < first < len(entries):
            before, after = stamp - entries[first - 1].stamp, entries[first].stamp - stamp
            first -= before < after
        return entries[first:]

    def clear(self) -> None:
        """Forget all frames."""
        self._full.clear()
        self._thinned.clear()
        self._bytes = 0
        self.dropped_until = 0

    def replace_all(self, entries: Sequence[HistoryEntry]) -> None:
        """Keep these, in the same order, in the place of all; without any, all were dropped."""
        dropped_until = self.last.stamp if len(self) and not entries else self.dropped_until
        self.clear()
        self.dropped_until = dropped_until
        reduced = [i for i, one in enumerate(entries) if isinstance(one.stored_frame, ReducedFrame)]
        thinned_out = reduced[-1] + 1 if reduced else 0
        self._thinned.extend(entries[:thinned_out])
        self._full.extend(entries[thinned_out:])
        self._bytes = sum(map(_bytes_of, entries))

    def replace_from(self, entries: Sequence[HistoryEntry]) -> None:
        """Put moments in the place of all from the first of their stamps on."""
        if entries:
            before = [one for one in self.entries if one.stamp < entries[0].stamp]
            self.replace_all([*before, *entries])

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
        entry = self._full.popleft()
        self._bytes -= _bytes_of(entry)
        is_last = entry.stamp // _SPACING != self._full[0].stamp // _SPACING
        if is_last or (entry.has_input and self._thinned):
            reduction = self._reduction(entry.frame.image)
            if reduction > 1:
                entry = replace(entry, stored_frame=ReducedFrame.of(entry.frame, reduction))
            self._thinned.append(entry)
            self._bytes += _bytes_of(entry)
        elif self._thinned:
            self._full[0] = self._full[0].merge_dropped(entry)
        else:
            self.dropped_until = entry.stamp

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


def thinned(entries: Sequence[HistoryEntry], most: int) -> list[HistoryEntry]:
    """At most so many moments after the first one, spread evenly; the last one is kept.

    Those of which somebody has said something are kept as well.
    """
    steps = min(len(entries) - 1, most)
    kept = set(np.linspace(0, len(entries) - 1, steps + 1).round().astype(int).tolist())
    chosen: list[HistoryEntry] = []
    skipped: list[HistoryEntry] = []
    for place, entry in enumerate(entries):
        if place not in kept and not entry.has_input:
            skipped.append(entry)
            continue
        chosen.append(reduce(HistoryEntry.merge_dropped, reversed(skipped), entry))
        skipped = []
    return chosen


def _bytes_of(entry: HistoryEntry) -> int:
    kept = entry.stored_frame
    return kept.pixels.nbytes if isinstance(kept, ReducedFrame) else _held_bytes(kept.image)


def _held_bytes(image: NDArray[np.generic]) -> int:
    """The memory that lives as long as the image: a view holds all of what it is a view of."""
    owner: Any = image
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return memoryview(owner).nbytes
