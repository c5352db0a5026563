"""The buffer of recent frames, for out-of-sequence detections and manual targets.

Each entry holds a frame, the tracks before it and its inputs, so that the frames since can be
reprocessed. Within a bound of memory, older frames are thinned out and reduced in resolution.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import DUPLICATE_ABOVE, Detection
from pf_tracker_ros.targets.tracks import Track, TrackKey, TrackSet
from pf_tracker_ros.values import replace

# Time span of thinned frames: a user draws a target within 2 s, and the rest is for transport.
_THINNED_SPAN = NANOSECONDS * 11 // 5
# Of the frames that memory does not suffice for, the last one in each such interval is kept.
_THINNED_INTERVAL = NANOSECONDS // 10
# Stamps that differ by less are the same, nanoseconds: ages of detections are rounded.
_SAME_STAMP = NANOSECONDS // 1000
# Share of the memory for thinned frames; the rest is for the newest frames.
_THINNED_SHARE = 0.55


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """A frame that is stored in reduced resolution.

    Each side of the image of the given shape is reduced by a power of 2. `frame_info` is the frame
    without its image, see `Frame.with_image`.
    """

    pixels: NDArray[Any]
    shape: tuple[int, ...]
    reduction: int
    frame_info: Frame

    @classmethod
    def of(cls, frame: Frame, reduction: int) -> ReducedFrame:
        """Reduce a frame by a power of 2, by repeated halving, which is fast."""
        pixels, shape = frame.image, frame.image.shape
        height, width = (length - length % reduction for length in shape[:2])
        pixels = pixels[:height, :width]
        for _ in range(reduction.bit_length() - 1):
            height, width = height // 2, width // 2
            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
        return cls(pixels, shape, reduction, frame.with_image(np.empty((0, 0))))

    def restored(self) -> Frame:
        """The frame with an image of the original size and type, interpolated."""
        height, width = (length * self.reduction for length in self.pixels.shape[:2])
        image = cv2.resize(self.pixels, (width, height), interpolation=cv2.INTER_LINEAR)
        below, beside = self.shape[0] - height, self.shape[1] - width
        if below or beside:
            image = cv2.copyMakeBorder(image, 0, below, 0, beside, cv2.BORDER_REPLICATE)
        return self.frame_info.with_image(image)


@dataclass(frozen=True, eq=False)
class HistoryEntry:
    """A frame with all that is needed to reprocess it.

    Attributes:
        stored_frame: The frame, in full or reduced resolution.
        interval: Seconds since the entry before.
        tracks_before: The track set before the frame.
        detections: In the frame; None if no detector has processed it.
        detections_offset: Nanoseconds between their stamp and that of the frame.
        started: Manual targets that start after the frame.
        stopped: Targets that a user stopped after the frame, as they were.
    """

    stored_frame: Frame | ReducedFrame
    interval: float
    tracks_before: TrackSet
    detections: tuple[Detection, ...] | None = None
    detections_offset: int = 0
    started: tuple[Track, ...] = ()
    stopped: tuple[Track, ...] = ()

    def without(self, keys: Collection[TrackKey]) -> HistoryEntry:
        """The same without some of the tracks before it."""
        before = self.tracks_before
        tracks = (track for track in before.tracks if track.key not in keys)
        return replace(self, tracks_before=before.with_tracks(tracks))

    def without_targets(self) -> HistoryEntry:
        """The same without any tracks, detections and manual targets."""
        return HistoryEntry(
            self.stored_frame,
            self.interval,
            replace(self.tracks_before, tracks=(), ended_tracks=()),
        )

    @property
    def frame(self) -> Frame:
        """The frame; restored at each call if it is stored reduced."""
        stored = self.stored_frame
        return stored.restored() if isinstance(stored, ReducedFrame) else stored

    @property
    def stamp(self) -> int:
        """Of the frame, nanoseconds."""
        return self._frame_info.stamp

    @property
    def has_input(self) -> bool:
        """Whether it has detections or manual targets, which must not be lost."""
        return self.detections is not None or bool(self.started or self.stopped)

    def with_detections(
        self, detections: tuple[Detection, ...] | None, offset: int
    ) -> HistoryEntry:
        """This entry with detections whose stamp is so many nanoseconds from that of the frame.

        Those of the same stamp are added to the known ones. Of another stamp the nearer ones count:
        what moves would be seen twice.
        """
        if detections is None:
            return self
        farther = offset - self.detections_offset
        if self.detections is None or farther < -_SAME_STAMP:
            return replace(self, detections=detections, detections_offset=offset)
        if farther > _SAME_STAMP:
            return self
        return replace(self, detections=merge_detections(self.detections, detections))

    def merge_dropped(self, dropped: HistoryEntry) -> HistoryEntry:
        """This entry with the interval and camera motion of a dropped entry just before it."""
        stored, motion = self.stored_frame, dropped._frame_info.camera_motion
        if motion is not None:
            info = self._frame_info.with_image(self._frame_info.image)
            since = info.camera_motion
            info.camera_motion = motion if since is None else since @ motion
            stored = replace(stored, frame_info=info) if isinstance(stored, ReducedFrame) else info
        interval = dropped.interval + self.interval
        return replace(
            self, stored_frame=stored, interval=interval, tracks_before=dropped.tracks_before
        )

    @property
    def _frame_info(self) -> Frame:
        stored = self.stored_frame
        return stored.frame_info if isinstance(stored, ReducedFrame) else stored


class FrameBuffer:
    """History entries in the order of their stamps, with bounds on number and memory.

    The newest frames are stored in full. If memory does not suffice for about two seconds, older
    ones are thinned out to ten a second and reduced as far as needed. A frame without a stamp (0)
    is not stored, since nothing can refer to it; it clears the buffer.

    Args:
        frames: Most frames; the newest is always stored.
        megabytes: Most memory for images, in units of 10^6 bytes.

    Attributes:
        dropped_until: Stamp of the newest frame that was dropped together with all before it, for
            the bounds or for a change of image size or type; 0 if none was.
    """

    def __init__(self, frames: int = 1, megabytes: float = 0.0) -> None:
        self._full: deque[HistoryEntry] = deque()
        # All older than those in `_full`.
        self._thinned: deque[HistoryEntry] = deque()
        self._bytes = 0
        self.dropped_until = 0
        self.limit(frames, megabytes)

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest frames beyond them are thinned out or dropped."""
        self._max_frames, self._megabytes = frames, megabytes
        self._trim()

    def empty_copy(self) -> FrameBuffer:
        """An empty buffer with the same bounds."""
        return FrameBuffer(self._max_frames, self._megabytes)

    def add(self, entry: HistoryEntry) -> None:
        """Append the newest entry.

        Earlier ones are dropped if the image size or type changes, or if time goes back.
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
            # The images derived from a frame are as large again, and seldom needed once more.
            last.clear_cache()
        self._full.append(entry)
        self._bytes += _held_bytes(image)
        while self._thinned and stamp - self._thinned[0].stamp > _THINNED_SPAN:
            self._drop_oldest()
        self._trim()

    def __len__(self) -> int:
        return len(self._thinned) + len(self._full)

    @property
    def entries(self) -> list[HistoryEntry]:
        """All entries, the oldest first."""
        return [*self._thinned, *self._full]

    @property
    def stamps(self) -> list[int]:
        """The stamps of all entries."""
        return [entry.stamp for entry in self.entries]

    @property
    def first(self) -> HistoryEntry:
        """The oldest entry."""
        return (self._thinned or self._full)[0]

    @property
    def last(self) -> HistoryEntry:
        """The newest entry."""
        return self._full[-1]

    @property
    def is_complete(self) -> bool:
        """Whether it reaches back to the first frame of all."""
        return len(self) > 0 and self.first.tracks_before.frame == 0

    def since(self, stamp: int) -> list[HistoryEntry]:
        """The entries from the one nearest to `stamp` on; none if all are before it."""
        entries = self.entries
        first = next((i for i, one in enumerate(entries) if one.stamp >= stamp), len(entries))
        if 0 < first < len(entries):
            before, after = stamp - entries[first - 1].stamp, entries[first].stamp - stamp
            first -= before < after
        return entries[first:]

    def clear(self) -> None:
        """Remove all entries."""
        self._full.clear()
        self._thinned.clear()
        self._bytes = 0
        self.dropped_until = 0

    def replace_all(self, entries: Sequence[HistoryEntry]) -> None:
        """Replace all entries, in the order of stamps; without any, all count as dropped."""
        dropped_until = self.last.stamp if len(self) and not entries else self.dropped_until
        self.clear()
        self.dropped_until = dropped_until
        reduced = [i for i, one in enumerate(entries) if isinstance(one.stored_frame, ReducedFrame)]
        thinned_out = reduced[-1] + 1 if reduced else 0
        self._thinned.extend(entries[:thinned_out])
        self._full.extend(entries[thinned_out:])
        self._bytes = sum(map(_bytes_of, entries))

    def replace_from(self, entries: Sequence[HistoryEntry]) -> None:
        """Replace the entries from the stamp of the first given one on."""
        if entries:
            before = [one for one in self.entries if one.stamp < entries[0].stamp]
            self.replace_all([*before, *entries])

    def _trim(self) -> None:
        while len(self) > max(self._max_frames, 1):
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
        """Reduce the oldest full frame, or drop it if its interval has a later one."""
        entry = self._full.popleft()
        self._bytes -= _bytes_of(entry)
        is_last = entry.stamp // _THINNED_INTERVAL != self._full[0].stamp // _THINNED_INTERVAL
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
        """The power of 2 by which frames are reduced so that all thinned ones fit."""
        held, most = _held_bytes(image), self._megabytes * 1e6
        room = min(_THINNED_SHARE * most, most - held)
        reduction = 1
        while held * (_THINNED_SPAN / _THINNED_INTERVAL) > room * reduction**2:
            if 2 * reduction > min(image.shape[:2]):
                break
            reduction *= 2
        return reduction


def merge_detections(
    known: tuple[Detection, ...], new: tuple[Detection, ...]
) -> tuple[Detection, ...]:
    """Add detections to those already known of a frame, without duplicates.

    The known ones keep their indices, which are part of the keys of tracks.
    """
    if not known:
        return new
    boxes = np.array([one.box for one in known])
    added = [one for one in new if pairwise_iou(one.box[None], boxes).max() <= DUPLICATE_ABOVE]
    return (*known, *added)


def thinned(entries: Sequence[HistoryEntry], most: int) -> list[HistoryEntry]:
    """The first entry and at most `most` later ones, evenly spaced, up to the last.

    Entries with detections or manual targets are kept in addition.
    """
    steps = min(len(entries) - 1, most)
    kept = set(np.linspace(0, len(entries) - 1, steps + 1).round().astype(int).tolist())
    chosen: list[HistoryEntry] = []
    skipped: list[HistoryEntry] = []
    for index, entry in enumerate(entries):
        if index not in kept and not entry.has_input:
            skipped.append(entry)
            continue
        chosen.append(reduce(HistoryEntry.merge_dropped, reversed(skipped), entry))
        skipped = []
    return chosen


def _bytes_of(entry: HistoryEntry) -> int:
    frame = entry.stored_frame
    return frame.pixels.nbytes if isinstance(frame, ReducedFrame) else _held_bytes(frame.image)


def _held_bytes(image: NDArray[np.generic]) -> int:
    """The memory that an image keeps alive; a view keeps all of its base."""
    owner: Any = image
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return memoryview(owner).nbytes
