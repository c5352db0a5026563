"""Files of labeled boxes, as trackers, benchmarks and labeling tools exchange them.

Each format is one module with a function that reads a path, and one that writes tracks; `FORMATS`
lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pf_tracker_ros.formats.boxes_csv import has_boxes_csv_heading, read_boxes_csv
from pf_tracker_ros.formats.coco import read_coco, write_coco
from pf_tracker_ros.formats.cvat import is_cvat, read_cvat, write_cvat
from pf_tracker_ros.formats.kitti import KITTI_COLUMNS, read_kitti, write_kitti
from pf_tracker_ros.formats.mot import read_mot, write_mot, write_mot_labels
from pf_tracker_ros.formats.tracks import (
    BoxTrack,
    FormatError,
    LabeledBox,
    RecordingInfo,
    describe_recording,
)
from pf_tracker_ros.formats.tracks import read_text as _read_text
from pf_tracker_ros.formats.yolo import is_yolo, read_yolo, write_yolo

__all__ = [
    "FORMATS",
    "BoxTrack",
    "FormatError",
    "LabeledBox",
    "RecordingInfo",
    "WriteTracks",
    "describe_recording",
    "read_tracks",
]


WriteTracks = Callable[[Path, Sequence[BoxTrack], RecordingInfo], None]
"""Writes tracks of a recording into a file."""

FORMATS: Mapping[str, Mapping[str, WriteTracks]] = {
    "mot": {"boxes.mot.txt": write_mot, "boxes.mot.labels.txt": write_mot_labels},
    "coco": {"boxes.coco.json": write_coco},
    "cvat": {"boxes.cvat.xml": write_cvat},
    "kitti": {"boxes.kitti.txt": write_kitti},
    "yolo": {"boxes.yolo.zip": write_yolo},
}
"""Name of each format to the files that `track` writes, with their writers."""

_ACCEPTED = (
    "allowed: boxes.csv of `track`, MOT challenge text, COCO JSON, CVAT for video 1.1 (XML, or the "
    "ZIP archive that CVAT exports), KITTI tracking, YOLO (a folder or ZIP archive of texts)"
)


def read_tracks(
    path: str | Path, describe: Callable[[], RecordingInfo] | None = None
) -> tuple[BoxTrack, ...]:
    """Read a file of labeled boxes in any of the formats; its content tells which.

    Args:
        path: Of the file, or of the folder of YOLO's texts.
        describe: Describes the recording. Called for YOLO's labels, which are shares of the size
            of each image.

    Returns:
        The tracks in the order of their ids, at least one; each has a box in its first frame.

    Raises:
        FormatError: It cannot be read, is in no known format, or has no box.
    """
    source = Path(path).expanduser()
    if is_yolo(source):
        return read_yolo(source, describe)
    if is_cvat(source):
        return read_cvat(source)
    text = _read_text(source)
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    if not first:
        raise FormatError(f"{source} is empty; {_ACCEPTED}")
    if first[0] in "{[":
        return read_coco(source)
    if has_boxes_csv_heading(first):
        return read_boxes_csv(source)
    # Labels of KITTI may have commas, and lines of the MOT challenge spaces.
    columns = len(first.split())
    if "," in first and columns < KITTI_COLUMNS:
        return read_mot(source)
    if columns > 1:
        return read_kitti(source)
    raise FormatError(f"{source} begins with {first[:40]!r}; {_ACCEPTED}")
