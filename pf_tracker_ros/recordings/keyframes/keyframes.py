"""The boxes that a person has given at some frames of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.formats import BoxTrack, FormatError, describe_recording, read_tracks
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.target import Target, read_targets

_YAML_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class KeyframeTrack:
    """A target with its keyframes.

    Attributes:
        id: From 1.
        label: Class or name, or empty.
        keyframes: Frame, counted from 0, to the box (x, y, width, height) in pixels, in order of
            the frames. None means that the target is absent from there to the next keyframe. The
            first one has a box.
        source: File of the keyframes, for messages.
    """

    id: int
    label: str
    keyframes: Mapping[int, Box | None]
    source: str


def read_keyframes(path: Path, recording: Recording) -> tuple[KeyframeTrack, ...]:
    """Read keyframes from a target file or a file of labeled boxes.

    Returns:
        The tracks, at least one.

    Raises:
        RecordingError: The file cannot be read, or belongs to another recording.
    """
    if path.suffix.lower() in _YAML_SUFFIXES:
        tracks = _from_targets(read_targets(path, recording.path), str(path))
    else:
        try:
            images = (frame.image for frame in recording.frames())
            found = read_tracks(path, lambda: describe_recording(recording.path.name, images))
            tracks = _from_tracks(found, str(path))
        except FormatError as error:
            raise RecordingError(str(error), WRONG_TARGET) from error
    if recording.frame_count is not None:
        check_within(tracks, recording.frame_count)
    return tracks


def check_within(tracks: Sequence[KeyframeTrack], frame_count: int) -> None:
    """Check that the keyframes with a box are frames of the recording.

    Raises:
        RecordingError: One is not.
    """
    for track in tracks:
        last = max(frame for frame, box in track.keyframes.items() if box is not None)
        if last >= frame_count:
            raise RecordingError(
                f"{track.source} has a box in frame {last}, counted from 0, but the recording has "
                f"{counted(frame_count, 'frame')}: it belongs to another recording",
                WRONG_TARGET,
            )


def _from_tracks(tracks: Sequence[BoxTrack], source: str) -> tuple[KeyframeTrack, ...]:
    # CVAT counts its tracks from 0.
    first = 1 if any(track.id == 0 for track in tracks) else 0
    found = []
    for track in tracks:
        keyframes = {
            frame: labeled.box for frame, labeled in track.boxes.items() if labeled.is_keyframe
        }
        if not any(keyframes.values()):
            raise RecordingError(
                f'{source}, track {track.id}: no box is a keyframe; allowed: keyframe="1"',
                WRONG_TARGET,
            )
        found.append(KeyframeTrack(track.id + first, track.label, _from_box(keyframes), source))
    return tuple(found)


def _from_targets(targets: Sequence[Target], source: str) -> tuple[KeyframeTrack, ...]:
    tracks = []
    for number, target in enumerate(targets, start=1):
        keyframes = dict(target.keyframes)
        if not keyframes:
            if target.frame is None and target.stamp:
                raise RecordingError(
                    f"{target.source} gives the frame of its box by 'stamp' only; keyframes need "
                    "'frame'",
                    WRONG_TARGET,
                )
            keyframes = {target.frame or 0: target.box}
        tracks.append(KeyframeTrack(number, target.label, _from_box(keyframes), source))
    return tuple(tracks)


def _from_box(keyframes: Mapping[int, Box | None]) -> dict[int, Box | None]:
    """The keyframes from the first one with a box on."""
    first = min(frame for frame, box in keyframes.items() if box is not None)
    return {frame: keyframes[frame] for frame in sorted(keyframes) if frame >= first}
