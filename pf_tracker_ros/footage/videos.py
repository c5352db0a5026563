"""Video files, read in order from the start, as seeking in compressed video is not exact."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing
from fractions import Fraction
from itertools import islice
from pathlib import Path

from pf_tracker_ros.footage.access import check_file, unreadable
from pf_tracker_ros.footage.base import (
    DEFAULT_FRAME_RATE,
    FIRST_STAMP,
    FootageError,
    PartialFootageError,
)
from pf_tracker_ros.footage.ground_truth import GROUND_TRUTH_FILES
from pf_tracker_ros.footage.video_decoding import A_TEXT, Video, not_a_video, open_video
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS

_FRAME_RATES = (0.01, 10_000.0)
# A single gap is this many times as long as those around it.
_LONG_GAP = 2.5


class VideoFootage:
    """The frames of a video file, or a range of them.

    Stamps are the container's times, counted from the first frame. The constructor decodes the
    first frame, to report errors early.

    Attributes:
        note: That the times of the file are not used, or may be wrong; after reading, where frames
            may be missing; as a sentence, or empty.

    Args:
        path: The file.
        first_frame: First frame to read, counted from 0.
        frame_count: Required number of frames from there; None reads to the end.
        frame_rate: Frames per second if the file has no rate.

    Raises:
        FootageError: The file cannot be read or decoded.
    """

    ground_truth = None

    def __init__(
        self,
        path: Path,
        *,
        first_frame: int = 0,
        frame_count: int | None = None,
        frame_rate: float = DEFAULT_FRAME_RATE,
    ) -> None:
        check_file(path, "video")
        self._path = path
        self._first_frame = first_frame
        self._required_count = frame_count
        video = self._open()
        with closing(video.pictures()) as pictures:
            if next(pictures, None) is None:
                raise FootageError(f"video {path}: no frame can be decoded")
        self.note = video.note
        slowest, fastest = _FRAME_RATES
        self._has_times = bool(video.interval and slowest <= 1.0 / video.interval <= fastest)
        if video.interval is not None and not self._has_times:
            self.note = (
                f"the frames of {path.name} are {video.interval:.3g} s apart on average, allowed: "
                f"{1.0 / fastest:g} to {1.0 / slowest:g} s; its times are not used, and "
                f"{frame_rate:g} frames/s are assumed"
            )
        self.nominal_interval = (self._has_times and video.interval) or 1.0 / frame_rate
        self.name = path.stem
        declared = None if video.frame_count is None else video.frame_count - first_frame
        self.frame_count = frame_count if frame_count is not None else declared

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        video = self._open()
        first, required = self._first_frame, self._required_count
        last = None if required is None else first + required
        stamps = _RisingStamps(self.nominal_interval)
        count = 0
        with closing(video.pictures(first)) as pictures:
            for image, time in islice(pictures, first, last):
                assert image is not None
                yield Frame(image, stamps.next(time if self._has_times else None))
                count += 1
        if count < (required or 1):
            raise self._too_short(count)
        if stamps.gaps and not video.has_frame_list:
            index, seconds = stamps.gaps[0]
            more = f" (first of {len(stamps.gaps)} gaps)" if len(stamps.gaps) > 1 else ""
            self.note = (
                f"frame {index} of {self._path.name} comes {seconds:.2f} s after the one before"
                f"{more}: the camera paused, or frames are missing"
            )
        damage = video.damage or stamps.damage
        if required is None and damage:
            raise PartialFootageError(f"video {self._path} {damage}")

    def _open(self) -> Video:
        try:
            if _has_text(self._path):
                raise self._is_text()
        except OSError as error:
            raise unreadable(self._path, "video", error) from error
        return open_video(self._path)

    def _is_text(self) -> FootageError:
        if self._path.name in GROUND_TRUTH_FILES:
            return FootageError(
                f"{self._path} is the ground truth of a sequence, not a video; give its folder, "
                f"{self._path.parent}"
            )
        return not_a_video(self._path, A_TEXT)

    def _too_short(self, frames_read: int) -> FootageError:
        count = self._required_count
        expected = "some frames" if count is None else counted(count, "frame")
        return FootageError(
            f"video {self._path}: {expected} expected from frame {self._first_frame} "
            f"(counted from 0), only {frames_read} could be decoded"
        )


class _RisingStamps:
    """Stamps of frames from their times, which may be missing or go back.

    Such a frame follows the last one by the nominal interval. A frame at the time of the last one
    is a nanosecond later.

    Attributes:
        damage: Where the time first went back, or empty.
        gaps: Index of a frame and seconds since the one before, where this is much longer than both
            before and after it.

    Args:
        interval: Nominal seconds from one frame to the next.
    """

    def __init__(self, interval: float) -> None:
        self._interval = Fraction(interval)
        self._count = 0
        self._last_time: Fraction | None = None
        # Seconds from the first frame to the last one.
        self._elapsed = Fraction(0)
        self._stamp = 0
        self._last_gaps = (Fraction(0), Fraction(0))
        self.damage = ""
        self.gaps: list[tuple[int, float]] = []

    def next(self, time: Fraction | None) -> int:
        """The stamp of the next frame in nanoseconds."""
        gap = self._interval if self._count else Fraction(0)
        if time is not None and self._last_time is not None:
            gap = time - self._last_time
            if gap < 0:
                gap = self._interval
                self.damage = (
                    self.damage or f"is damaged: its time goes back at frame {self._count}"
                )
        self._elapsed += gap
        earlier, last = self._last_gaps
        if self._count > 2 and last > _LONG_GAP * max(earlier, gap):
            self.gaps.append((self._count - 1, float(last)))
        self._last_gaps = (last, gap)
        self._last_time = time
        self._count += 1
        self._stamp = max(self._stamp + 1, FIRST_STAMP + round(self._elapsed * NANOSECONDS))
        return self._stamp


_HEAD_SIZE = 4096

# A line of text before raw frames, which contain no byte of 0 if they are dark gray.
_TEXT_HEADED_VIDEO = b"YUV4MPEG2 "

# Playlists of FFmpeg: HLS, lists of files, session descriptions and DASH, even among other bytes.
_PLAYLIST = re.compile(rb"\A\W*(#EXTM3U|ffconcat)|^c=IN IP|<MPD\b", re.IGNORECASE | re.MULTILINE)
_WIDE_TEXT = (b"\xff\xfe", b"\xfe\xff")


def _has_text(path: Path) -> bool:
    """Whether a file is a text or a playlist.

    Videos have bytes of 0 near their beginning, texts do not. FFmpeg would play a text as terminal
    output, and a playlist by opening the files and addresses in it.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_SIZE)
    if head.startswith(_TEXT_HEADED_VIDEO):
        return False
    is_plain = bool(head) and b"\0" not in head
    return is_plain or head.startswith(_WIDE_TEXT) or _PLAYLIST.search(head) is not None
