"""Videos decoded by PyAV.

What the container promises is compared with what was read:

1. A file with a list of its frames (MP4, MOV, AVI) has to contain as many packets.
2. From the first frame that is shown, each H.264 and H.265 packet of such a file has to be shown.
3. Packets of another file have to reach its declared duration.
4. Each packet has to be decoded without an error, into frames that are not marked as corrupt, and
   has to be complete.

The decoders of H.264, MPEG-4, MPEG-2 and ProRes mark pictures in which they conceal damage. That of
Motion JPEG only refuses them if it is told to, see `_StrictDecoder`. Those of H.265, VP8, VP9 and
others do not notice most damage inside of a picture.

Frames that an edit list excludes, and leading frames whose references were cut off, are not shown
by any player, and are not missing here.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.footage.video_decoding import A_TEXT, Picture, Pictures, not_a_video
from pf_tracker_ros.plurals import counted

# Nothing but the file itself is opened, whatever is written in it.
_OPTIONS = {"protocol_whitelist": "file"}
# Declared durations may end with the sound.
_DURATION_TOLERANCE = Fraction(1, 5)
_MICROSECONDS = 1_000_000
# Of the intervals in an AVI, which may be rounded.
_INTERVAL_TOLERANCE = 0.01
# Each packet is a frame: others may split one, or contain one that is not shown.
_COUNTED_CODECS = ("h264", "hevc")
# Bytes below glibc's DEFAULT_MMAP_THRESHOLD_MAX.
_LARGEST_REUSED = 32_000_000
# Each picture is independent, and damage is told only by an error.
_STRICT_CODECS = ("mjpeg",)
# FFmpeg's decoder of texts, which it may also choose by the file name.
_TERMINAL_CODEC = "ansi"


class PyavVideo:
    """A video file.

    Attributes:
        frame_count: Number of frames that are to be shown, according to the file.
        has_frame_list: Whether the file has a list of its frames, so that missing ones are noticed.
        interval: Mean seconds from one frame to the next, None if unknown.
        note: What the file contradicts itself in, as a sentence, or empty.
        damage: After `pictures` has ended: what is missing or damaged, as "is damaged: ...", or
            empty.

    Args:
        path: The file.

    Raises:
        FootageError: It is no video.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.damage = ""
        _reuse_freed_memory()
        with self._open() as container:
            stream = self._stream(container)
            rate = stream.average_rate or stream.guessed_rate
            self.interval = float(1 / rate) if rate else None
            is_avi = container.format.name == "avi"
            self.note = _contradiction(path, stream.time_base) if is_avi else ""
            # Tuple: the index belongs to the container.
            listed = tuple(entry.is_discard for entry in stream.index_entries)
            self.has_frame_list = 0 < stream.frames <= len(listed)
            if self.has_frame_list:
                self.frame_count = listed.count(False)
            else:
                self._count(container, stream)

    def pictures(self, first: int = 0) -> Pictures:
        """Decode the frames in the order of display.

        Args:
            first: Number of frames to decode without making images of them.
        """
        with self._open() as container:
            stream = self._stream(container)
            stream.thread_type = "AUTO"
            # The times in AVI are those of decoding, a constant before those of display.
            has_decoding_times = container.format.name == "avi"
            # One for all frames, because a new one is slow to prepare.
            converter = VideoReformatter()
            strict = _StrictDecoder(stream, self._open) if _is_strict(stream) else None
            reading = _Reading(container, stream, strict, has_frame_list=self.has_frame_list)
            for index, frame in enumerate(reading.frames()):
                number = frame.dts if has_decoding_times else frame.pts
                time = None if number is None else number * Fraction(frame.time_base or 0)
                image = self._image(frame, converter) if index >= first else None
                yield Picture(image, time)
            if damage := reading.damage:
                self.damage = f"is damaged: {damage}"

    def _open(self) -> InputContainer:
        try:
            # With a prefix, no file name is taken for a network address.
            name = f"file:{self._path.absolute()}"
            return av.open(name, options=_OPTIONS, metadata_errors="replace")
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise not_a_video(self._path, reason) from error

    def _stream(self, container: InputContainer) -> av.VideoStream:
        for stream in container.streams.video:
            if stream.codec_context is None:
                raise not_a_video(self._path, "its codec is unknown")
            if stream.codec_context.name == _TERMINAL_CODEC:
                raise not_a_video(self._path, A_TEXT)
            return stream
        raise not_a_video(self._path, "it has no pictures")

    def _image(self, frame: av.VideoFrame, converter: VideoReformatter) -> NDArray[Any]:
        """The image of a frame, as it is to be shown."""
        try:
            image = converter.reformat(frame, format="bgr24", threads=1).to_ndarray()
        except (av.FFmpegError, ValueError, MemoryError) as error:
            raise FootageError(
                f"video {self._path}: a frame ({frame.width}x{frame.height}, {frame.format.name}) "
                f"cannot be converted: {error}"
            ) from error
        turns = round(frame.rotation / 90) % 4
        return np.ascontiguousarray(np.rot90(image, turns)) if turns else image

    def _count(self, container: InputContainer, stream: av.VideoStream) -> None:
        """Count the frames of a file without a list of them, without decoding it."""
        times: list[int] = []
        self.frame_count, is_decodable = 0, False
        # An error is reported when the frames are read.
        with suppress(av.FFmpegError, OSError):
            for packet in container.demux(stream):
                is_decodable = is_decodable or packet.is_keyframe
                if packet.size and is_decodable and not packet.is_discard:
                    self.frame_count += 1
                    times += [packet.pts] if packet.pts is not None else []
        if len(times) > 1 and stream.time_base:
            self.interval = float((max(times) - min(times)) * stream.time_base / (len(times) - 1))


@functools.cache
def _reuse_freed_memory() -> None:
    """Let the C library reuse the memory of a freed image for the next one.

    glibc returns large freed blocks to the system, which clears each of their pages when they are
    used again. For many sizes this would take as long as the conversion of the image. A block that
    is freed raises the size from which this happens up to its own. Not a page of this one is used,
    and other C libraries are not affected. See mallopt(3), M_MMAP_THRESHOLD.
    """
    np.empty(_LARGEST_REUSED, np.uint8)


def _contradiction(path: Path, time_base: Fraction | None) -> str:
    """The note for an AVI whose header has two frame intervals: no checksum tells which is right.

    Args:
        path: The file.
        time_base: Interval of the stream header (strh), seconds, which is used.
    """
    # RIFF header, list hdrl, chunk avih: its first field, microseconds.
    with path.open("rb") as file:
        content = file.read(36)
    other = int.from_bytes(content[32:36], "little")
    if content[24:28] != b"avih" or not other or not time_base:
        return ""
    used = float(time_base * _MICROSECONDS)
    if abs(used - other) <= max(_INTERVAL_TOLERANCE * used, 1.0):
        return ""
    return (
        f"the header of {path.name} gives two intervals between frames, {used / 1000:.6g} (used) "
        f"and {other / 1000:.6g} ms; the times may be wrong"
    )


def _is_strict(stream: av.VideoStream) -> bool:
    return stream.codec_context.name in _STRICT_CODECS


class _StrictDecoder:
    """Decodes pictures, each by itself, strictly first, and as far as possible if that fails.

    Args:
        stream: The stream; its decoder is set up.
        open_container: Opens the file again, for a second decoder.
    """

    def __init__(
        self, stream: av.VideoStream, open_container: Callable[[], InputContainer]
    ) -> None:
        # Threads would report the error of a picture with a later one.
        stream.thread_type = "NONE"
        stream.codec_context.options = {"err_detect": "explode"}
        self._index = stream.index
        self._open = open_container
        # The container is kept, since its stream ends with it.
        self._lenient: tuple[InputContainer, Any] | None = None

    def decode(self, packet: av.Packet[Any]) -> list[tuple[av.VideoFrame, bool]]:
        """The frames of a packet, and whether each is damaged.

        Raises:
            av.FFmpegError: Nothing can be decoded.
        """
        try:
            return [(frame, frame.is_corrupt) for frame in packet.decode()]
        except av.FFmpegError:
            if self._lenient is None:
                container = self._open()
                decoder: Any = container.streams[self._index].codec_context
                self._lenient = container, decoder
            return [(frame, True) for frame in self._lenient[1].decode(packet)]


class _Reading:
    """One pass through a file."""

    def __init__(
        self,
        container: InputContainer,
        stream: av.VideoStream,
        strict: _StrictDecoder | None,
        *,
        has_frame_list: bool,
    ) -> None:
        self._container = container
        self._strict = strict
        self._has_frame_list = has_frame_list
        self._stream = stream
        self._packet_count = 0
        self._frame_count = 0
        self._end = Fraction(0)
        # Times of packets that are to be shown, and of the first frame.
        self._times: list[int] = []
        self._first_time: int | None = None
        self._error = ""
        # Numbers of frames at which packets failed, and of damaged frames.
        self._failed: list[int] = []
        self._corrupt: list[int] = []

    def frames(self) -> Iterator[av.VideoFrame]:
        """Decode the frames."""
        for packet in self._packets():
            for frame, is_damaged in self._decode(packet):
                if is_damaged or packet.is_corrupt:
                    self._corrupt.append(self._frame_count)
                self._frame_count += 1
                if self._first_time is None:
                    self._first_time = frame.pts
                yield frame

    @property
    def damage(self) -> str:
        """What is missing or damaged, or empty."""
        return next(self._findings(), "")

    def _findings(self) -> Iterator[str]:
        shown = counted(self._frame_count, "frame")
        if self._error:
            yield f"it cannot be read after {shown} ({self._error})"
        if self._packet_count < self._stream.frames:
            listed = counted(self._stream.frames, "frame")
            yield f"it contains {self._packet_count} of its {listed}"
        declared = Fraction(self._container.duration or 0, _MICROSECONDS)
        if not self._stream.frames and self._end < declared - self._duration_tolerance:
            yield f"it ends after {float(self._end):.2f} of {float(declared):.2f} s"
        if self._failed:
            failed = counted(len(self._failed), "frame")
            yield f"{failed} could not be decoded, the first near frame {self._failed[0]}"
        if missing := self._missing_count():
            yield f"{counted(missing, 'frame')} could not be decoded"
        if self._corrupt:
            corrupt = counted(len(self._corrupt), "damaged frame")
            yield f"it has {corrupt}, the first is frame {self._corrupt[0]}"

    @property
    def _duration_tolerance(self) -> Fraction:
        """Seconds by which the packets may end before the declared duration."""
        rate = self._stream.average_rate
        if len(self._container.streams) > 1 or not rate:
            return _DURATION_TOLERANCE
        # The duration of the last frame may not be in the file.
        return min(_DURATION_TOLERANCE, Fraction(3, 2) / rate)

    def _packets(self) -> Iterator[av.Packet[Any]]:
        """The packets of the video; those of the sound only count for the duration."""
        try:
            for packet in self._container.demux():
                if packet.size and packet.pts is not None:
                    end = (packet.pts + (packet.duration or 0)) * packet.time_base
                    self._end = max(self._end, end)
                if packet.stream_index == self._stream.index:
                    self._packet_count += bool(packet.size)
                    if packet.size and packet.pts is not None and not packet.is_discard:
                        self._times.append(packet.pts)
                    yield packet
        except (av.FFmpegError, OSError) as error:
            self._error = getattr(error, "strerror", None) or str(error)

    def _decode(self, packet: av.Packet[Any]) -> list[tuple[av.VideoFrame, bool]]:
        """The frames of a packet, and whether each is known to be damaged."""
        try:
            if self._strict:
                return self._strict.decode(packet)
            return [(frame, frame.is_corrupt) for frame in packet.decode()]
        except av.FFmpegError:
            self._failed.append(self._frame_count)
            return []

    def _missing_count(self) -> int:
        """Number of packets without a frame."""
        is_counted = self._has_frame_list and self._stream.codec_context.name in _COUNTED_CODECS
        if not is_counted or self._first_time is None:
            return 0
        first = self._first_time
        return max(0, sum(time >= first for time in self._times) - self._frame_count)
