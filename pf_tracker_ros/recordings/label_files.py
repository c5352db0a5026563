"""The results as files of labeled boxes for other tools, and as a target file with keyframes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pf_tracker_ros.formats import FORMATS, BoxTrack, LabeledBox, RecordingInfo, WriteTracks
from pf_tracker_ros.formats.tracks import with_keyframes
from pf_tracker_ros.recordings.tables import single_line
from pf_tracker_ros.recordings.target import Target, file_text
from pf_tracker_ros.recordings.tracking import TrackedFrame, published_box

TARGET_FORMAT = "target"
FORMAT_NAMES = (*FORMATS, TARGET_FORMAT)
"""Values of `--format`."""


def _write_targets(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    targets = []
    for track in tracks:
        boxes = track.boxes
        if not any(labeled.is_keyframe for labeled in boxes.values()):
            boxes = with_keyframes(boxes)
        keyframes = [(frame, one.box) for frame, one in boxes.items() if one.is_keyframe]
        first, box = next((frame, box) for frame, box in keyframes if box is not None)
        targets.append(Target(box, frame=first, label=track.label, keyframes=tuple(keyframes)))
    text = file_text(targets, Path(info.name), "tracked") if targets else ""
    path.write_text(text, encoding="utf-8")


def label_files(formats: Sequence[str]) -> dict[str, WriteTracks]:
    """Name of each file of formats to its writer."""
    files: dict[str, WriteTracks] = {}
    for name in formats:
        is_target = name == TARGET_FORMAT
        files |= {"boxes.target.yaml": _write_targets} if is_target else FORMATS[name]
    return files


class LabelFile:
    """Collects the tracks, and writes them in a format after the last frame.

    Args:
        path: Of the new file.
        name: Name of the recording's file or folder.
        write_tracks: Of the format.
    """

    note = ""

    def __init__(self, path: Path, name: str, write_tracks: WriteTracks) -> None:
        self._path = path
        self._name = name
        self._write_tracks = write_tracks
        self._frame_count = 0
        self._image_sizes: dict[int, tuple[int, int]] = {}
        self._boxes: dict[int, dict[int, LabeledBox]] = {}
        self._labels: dict[int, str] = {}

    def write(self, tracked: TrackedFrame) -> None:
        """Add a frame."""
        self._frame_count = tracked.frame.index + 1
        if tracked.frame.image is not None:
            height, width = tracked.frame.image.shape[:2]
            if next(reversed(self._image_sizes.values()), None) != (width, height):
                self._image_sizes[tracked.frame.index] = width, height
        for target in tracked.targets:
            box = published_box(target.estimate)
            if box is None and target.id not in self._boxes:
                continue
            self._boxes.setdefault(target.id, {})[tracked.frame.index] = LabeledBox(
                box,
                occluded=target.estimate.state == "occluded",
                confidence=float(target.estimate.confidence),
                is_keyframe=target.id in tracked.keyframes,
            )
            self._labels[target.id] = single_line(target.label) or self._labels.get(target.id, "")

    def close(self) -> None:
        """Write the file.

        Raises:
            OSError: It cannot be written.
        """
        tracks = [BoxTrack(id, self._labels[id], self._boxes[id]) for id in sorted(self._boxes)]
        info = RecordingInfo(self._name, self._frame_count, self._image_sizes)
        self._write_tracks(self._path, tracks, info)

    def discard(self) -> None:
        """Do nothing: the file is not open before `close`."""
