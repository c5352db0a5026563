"""YOLO's labels: a folder or ZIP archive with a text for each frame, and in it a line for each box.

    class center_x center_y width height [confidence] [track id]

Classes count from 0; their labels are in `classes.txt` or `obj.names`, a line each, or under
`names` in `data.yaml`. Coordinates are shares of the image's width and height, so reading needs the
recording. A sixth column is a track id if it is a whole number in every line, else a
confidence. Without track ids, each class is a track, with at most one box in a frame.

The number of the frame ends the file's name: `drive_000012.txt`. It counts from 0, as CVAT writes
it; without leading zeros from 1, as Ultralytics writes `drive_12.txt` for the frames of a video.

The writer leaves out track ids and confidences, as Ultralytics refuses such lines in training.
See https://docs.ultralytics.com/datasets/detect/.
"""

from __future__ import annotations

import functools
import json
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath

from pf_tracker_ros.formats.tracks import (
    UNLABELED,
    BoxTrack,
    FormatError,
    LabeledBox,
    RecordingInfo,
    TracksBuilder,
    as_number,
    as_whole,
    four_numbers,
    present_boxes,
    read_text,
)
from pf_tracker_ros.yaml_files import YamlError, parse_yaml

_COORDINATES = ("center x", "center y", "the width", "the height")
_NUMBERED = re.compile(r"(?:.*\D)?(\d+)\.txt")
_LABEL_LISTS = ("classes.txt", "obj.names")
# Bytes of all texts in an archive; a small archive can expand beyond any memory.
_MAX_SIZE = 2**30
_ARCHIVE_ERRORS = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError)
# Digits of a share: a thousandth of a pixel in images of 10,000 px.
_DIGITS = 7


def is_yolo(path: Path) -> bool:
    """Whether a folder, or an archive, has texts with numbers in their names."""
    try:
        return any(_NUMBERED.fullmatch(name.name) for name, _ in _members(path))
    except (OSError, UnicodeDecodeError, *_ARCHIVE_ERRORS):
        return False


def read_yolo(path: Path, describe: Callable[[], RecordingInfo] | None) -> tuple[BoxTrack, ...]:
    """Read a folder or an archive.

    Args:
        path: Of the folder or archive.
        describe: Describes the recording.

    Raises:
        FormatError: It cannot be read, or the recording is unknown.
    """
    if describe is None:
        raise FormatError(f"{path} has shares of the image's size; it is read with its recording")
    try:
        members = dict(_members(path))
        labels = _labels(members)
        texts = {name: read() for name, read in members.items() if _NUMBERED.fullmatch(name.name)}
    except (OSError, UnicodeDecodeError, *_ARCHIVE_ERRORS) as error:
        raise FormatError(f"{path} cannot be read ({error})") from error
    except YamlError as error:
        raise FormatError(f"{path}, data.yaml: {error}") from error
    lines = [
        (name, number, line.split())
        for name, text in sorted(texts.items())
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip()
    ]
    first = _first_frame(texts)
    with_ids = _with_ids([cells for _, _, cells in lines])
    info = describe() if lines else RecordingInfo(path.name, 0, {})
    tracks = TracksBuilder(path)
    for name, number, cells in lines:
        try:
            frame = _number(name) - first
            category = as_whole(cells[0], "the class")
            if not 5 <= len(cells) <= 7:
                raise ValueError(
                    f"it has {len(cells)} columns; allowed: 5 of a box, with confidence and track "
                    "id up to 7"
                )
            x, y, w, h = four_numbers(cells[1:5], _COORDINATES)
            width, height = info.size_at(frame)
            box = ((x - w / 2) * width, (y - h / 2) * height, w * width, h * height)
            has_confidence = len(cells) > 5 + with_ids
            confidence = as_number(cells[5], "the confidence") if has_confidence else float("nan")
            id = as_whole(cells[-1], "the track id") if with_ids else category
            tracks.add(id, frame, LabeledBox(box, confidence=confidence), _label(category, labels))
        except ValueError as error:
            advice = "" if with_ids else "; write track ids, or one box of each class in a frame"
            raise FormatError(f"{path}, {name}, line {number}: {error}{advice}") from error
    return tracks.tracks()


def write_yolo(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write an archive, with a text for each frame of the recording with a box."""
    labels = sorted({track.label or UNLABELED for track in tracks})
    texts: dict[int, list[str]] = {}
    for frame, track, _, (x, y, w, h) in present_boxes(tracks):
        width, height = info.size_at(frame)
        shares = ((x + w / 2) / width, (y + h / 2) / height, w / width, h / height)
        numbers = " ".join(f"{share:.{_DIGITS}f}" for share in shares)
        texts.setdefault(frame, []).append(f"{labels.index(track.label or UNLABELED)} {numbers}\n")
    stem = PurePosixPath(info.name).stem
    names = "".join(f"  {number}: {json.dumps(label)}\n" for number, label in enumerate(labels))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.yaml", f"path: .\ntrain: images\nval: images\nnames:\n{names}")
        archive.writestr("classes.txt", "".join(f"{label}\n" for label in labels))
        for frame, lines in sorted(texts.items()):
            archive.writestr(f"labels/{stem}_{frame:06d}.txt", "".join(lines))


def _members(path: Path) -> Iterator[tuple[PurePosixPath, Callable[[], str]]]:
    """Name of each text of a folder or archive, and a function that reads it."""
    if path.is_dir():
        for file in path.rglob("*"):
            if file.is_file():
                yield PurePosixPath(file.relative_to(path)), functools.partial(read_text, file)
        return
    with zipfile.ZipFile(path) as archive:
        infos = archive.infolist()
        if sum(info.file_size for info in infos) > _MAX_SIZE:
            raise zipfile.BadZipFile(f"it is larger than {_MAX_SIZE >> 20} MiB")
        for info in infos:
            name = PurePosixPath(info.filename)
            if name.suffix in {".txt", ".names", ".yaml"}:
                text = archive.read(info).decode("utf-8-sig")
                yield name, functools.partial(str, text)


def _labels(members: Mapping[PurePosixPath, Callable[[], str]]) -> Mapping[int, str]:
    """Class to label; empty without a list."""
    for name, read in members.items():
        if name.name in _LABEL_LISTS:
            return dict(enumerate(line.strip() for line in read().splitlines() if line.strip()))
    for name, read in members.items():
        if name.name == "data.yaml":
            document = parse_yaml(read())
            names = document.get("names") if isinstance(document, dict) else None
            pairs = names.items() if isinstance(names, dict) else enumerate(names or ())
            return {int(number): str(label) for number, label in pairs}
    return {}


def _label(category: int, labels: Mapping[int, str]) -> str:
    if not labels:
        return f"class {category}"
    if category not in labels:
        raise ValueError(f"the class is {category}; allowed: 0 to {max(labels)}")
    return labels[category]


def _number(name: PurePosixPath) -> int:
    found = _NUMBERED.fullmatch(name.name)
    assert found is not None
    return as_whole(found[1], "the number in the name")


def _first_frame(names: Mapping[PurePosixPath, str]) -> int:
    """The number of the first frame: 0, but 1 without leading zeros."""
    digits = [found[1] for name in names if (found := _NUMBERED.fullmatch(name.name))]
    has_zeros = any(number.startswith("0") for number in digits)
    return 0 if has_zeros else 1


def _with_ids(lines: Sequence[Sequence[str]]) -> bool:
    """Whether the last column is a track id."""
    return bool(lines) and all(
        len(cells) == 7 or (len(cells) == 6 and cells[5].isdecimal()) for cells in lines
    )
