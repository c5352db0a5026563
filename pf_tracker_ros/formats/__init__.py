"""Files of labeled boxes, as trackers, benchmarks and labeling tools exchange them.

Each format is one module with `read(path)` and `write(path, tracks, info)`; `FORMATS` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from pf_tracker_ros.formats import boxes_csv, coco, cvat, kitti, mot
from pf_tracker_ros.formats.tracks import BoxTrack, FormatError, LabeledBox, RecordingInfo
from pf_tracker_ros.formats.tracks import read_text as _read_text

__all__ = ["FORMATS", "BoxTrack", "FormatError", "LabeledBox", "RecordingInfo", "read_tracks"]


class BoxFormat(NamedTuple):
    """A format that can be written.

    Attributes:
        files: Name of each file that `track` writes to its writer.
        title: Its full name.
    """

    files: Mapping[str, Callable[[Path, Sequence[BoxTrack], RecordingInfo], None]]
    title: str


FORMATS: Mapping[str, BoxFormat] = {
    "mot": BoxFormat(
        {"boxes.mot.txt": mot.write, "boxes.mot.labels.txt": mot.write_labels},
        "text of the MOT challenge",
    ),
    "coco": BoxFormat({"boxes.coco.json": coco.write}, "COCO JSON with videos"),
    "cvat": BoxFormat({"boxes.cvat.xml": cvat.write}, "CVAT for video 1.1"),
    "kitti": BoxFormat({"boxes.kitti.txt": kitti.write}, "KITTI tracking"),
}
"""Name of each format that `track` writes."""

_ACCEPTED = (
    "allowed: boxes.csv of `track`, MOT challenge text, COCO JSON, CVAT for video 1.1 (XML, or the "
    "ZIP archive that CVAT exports), KITTI tracking"
)


def read_tracks(path: str | Path) -> tuple[BoxTrack, ...]:
    """Read a file of labeled boxes in any of the formats; its content tells which.

    Args:
        path: The file.

    Returns:
        The tracks in the order of their ids, at least one; each has a box in its first frame.

    Raises:
        FormatError: It cannot be read, is in no known format, or has no box.
    """
    source = Path(path).expanduser()
    if cvat.is_cvat(source):
        return cvat.read(source)
    text = _read_text(source)
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    if not first:
        raise FormatError(f"{source} is empty; {_ACCEPTED}")
    if first[0] in "{[":
        return coco.read(source)
    if boxes_csv.is_heading(first):
        return boxes_csv.read(source)
    # Labels of KITTI may have commas, and lines of the MOT challenge spaces.
    columns = len(first.split())
    if "," in first and columns < kitti.COLUMNS:
        return mot.read(source)
    if columns > 1:
        return kitti.read(source)
    raise FormatError(f"{source} begins with {first[:40]!r}; {_ACCEPTED}")
