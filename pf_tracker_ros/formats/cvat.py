"""CVAT for video 1.1: XML with a `track` for each target and a `box` in its frames.

Frames count from 0, corners are in pixels counted from 0. `outside` means that the target is absent
from this frame on. CVAT writes every box, but when it reads a file it keeps only those with
`keyframe`, and interpolates linearly between them. Keyframes are written sparsely, so that a
correction in CVAT takes effect on the frames around it.
See https://docs.cvat.ai/docs/dataset_management/formats/format-cvat/.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from pf_tracker_ros.boxes import bounding_box_of_rotated
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file
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
    interpolated,
    number_text,
    with_keyframes,
)

_CORNERS = ("xtl", "ytl", "xbr", "ybr")
_IN_ARCHIVE = "annotations.xml"
# Bytes of the XML in an archive; a small archive can expand beyond any memory.
_MAX_SIZE = 2**30
# Frames between keyframes that are filled in: two boxes can be any number of frames apart.
_MAX_FILLED = 10**7
# Damaged, encrypted, or of an unknown compression.
_ARCHIVE_ERRORS = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError)
_ACCEPTED = 'in CVAT, export as "CVAT for video 1.1"'


def is_cvat(path: Path) -> bool:
    """Whether a file is XML or an archive, by its first bytes; False if it cannot be read."""
    try:
        check_file(path, "file of boxes")
        with path.open("rb") as file:
            head = file.read(64)
    except (FootageError, OSError):
        return False
    return head.startswith(b"PK") or head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")


def read_cvat(path: Path) -> tuple[BoxTrack, ...]:
    """Read an XML file, or the archive of an export; raises FormatError."""
    try:
        root = _parse(path)
    except (ElementTree.ParseError, LookupError, OSError, ValueError, *_ARCHIVE_ERRORS) as error:
        raise FormatError(f"{path} cannot be read as XML ({error}); {_ACCEPTED}") from error
    if root.tag != "annotations":
        raise FormatError(f"{path} has the root element <{root.tag}>; {_ACCEPTED}")
    elements = root.findall("track")
    if not elements:
        found = "<image> elements" if root.find("image") is not None else "no <track> element"
        raise FormatError(f"{path} has {found}; {_ACCEPTED}")
    tracks, filled = TracksBuilder(path), 0
    for number, element in enumerate(elements):
        place = f"{path}, track {element.get('id', f'number {number + 1}')}"
        try:
            id = as_whole(element.get("id", str(number)), "'id'")
            given = _boxes(element)
            filled += max(given) - min(given) if given else 0
            if filled > _MAX_FILLED:
                raise ValueError(f": more than {_MAX_FILLED} frames lie between the boxes")
            boxes = interpolated(given)
        except ValueError as error:
            raise FormatError(f"{place}{error}") from error
        for frame, labeled in boxes.items():
            try:
                tracks.add(id, frame, labeled, element.get("label", ""))
            except ValueError as error:
                raise FormatError(f"{place}, frame {frame}: {error}") from error
    return tracks.tracks()


def write_cvat(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write an XML file."""
    width, height = info.size_at(0)
    labels = sorted({track.label or UNLABELED for track in tracks})
    with path.open("w", encoding="utf-8", errors="replace") as file:
        file.write('<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n')
        file.write("  <version>1.1</version>\n  <meta>\n    <task>\n")
        file.write(f"      <size>{info.frame_count}</size>\n      <mode>interpolation</mode>\n")
        file.write("      <labels>\n")
        for label in labels:
            file.write(f"        <label><name>{quoteattr(label)[1:-1]}</name></label>\n")
        file.write("      </labels>\n      <original_size>\n")
        file.write(f"        <width>{width}</width>\n        <height>{height}</height>\n")
        file.write("      </original_size>\n    </task>\n  </meta>\n")
        for track in tracks:
            label = quoteattr(track.label or UNLABELED)
            file.write(f'  <track id="{track.id}" label={label} source="auto">\n')
            for line in _box_lines(track, info.frame_count):
                file.write(f"    {line}\n")
            file.write("  </track>\n")
        file.write("</annotations>\n")


def _box_lines(track: BoxTrack, frame_count: int) -> Iterator[str]:
    """The elements of the boxes; an absence is a keyframe in its first frame."""
    corners, last, is_absent = "", -1, False
    for frame, labeled in with_keyframes(track.boxes).items():
        if last >= 0 and frame > last + 1 and not is_absent:
            yield _line(last + 1, corners, outside=True)
            is_absent = True
        if labeled.box is not None:
            x, y, width, height = labeled.box
            values = map(number_text, (x, y, x + width, y + height))
            corners = " ".join(
                f'{name}="{value}"' for name, value in zip(_CORNERS, values, strict=True)
            )
            yield _line(frame, corners, occluded=labeled.occluded, is_keyframe=labeled.is_keyframe)
        elif not is_absent:
            yield _line(frame, corners, outside=True)
        is_absent, last = labeled.box is None, frame
    # Otherwise CVAT would show the last box to the end.
    if not is_absent and last + 1 < frame_count:
        yield _line(last + 1, corners, outside=True)


def _line(
    frame: int,
    corners: str,
    *,
    outside: bool = False,
    occluded: bool = False,
    is_keyframe: bool = True,
) -> str:
    return (
        f'<box frame="{frame}" outside="{int(outside)}" occluded="{int(occluded)}" '
        f'keyframe="{int(is_keyframe)}" {corners} z_order="0"></box>'
    )


class _PlainTreeBuilder(ElementTree.TreeBuilder):
    """Builds the tree of a document without entities of its own.

    These can expand beyond any memory, and can name other files.
    """

    def doctype(self, name: str, public_id: str | None, system: str | None) -> None:
        """Refuse a document type, the place where entities are declared."""
        raise ValueError("a <!DOCTYPE> is not allowed, because it can declare entities")


def _parse(path: Path) -> ElementTree.Element:
    parser = ElementTree.XMLParser(target=_PlainTreeBuilder())
    if not zipfile.is_zipfile(path):
        return ElementTree.parse(path, parser).getroot()
    with zipfile.ZipFile(path) as archive:
        if _IN_ARCHIVE not in archive.namelist():
            raise ValueError(f"the archive has no {_IN_ARCHIVE}")
        if archive.getinfo(_IN_ARCHIVE).file_size > _MAX_SIZE:
            raise ValueError(f"its {_IN_ARCHIVE} is larger than {_MAX_SIZE >> 20} MiB")
        with archive.open(_IN_ARCHIVE) as file:
            return ElementTree.parse(file, parser).getroot()


def _boxes(track: ElementTree.Element) -> Mapping[int, LabeledBox]:
    """Frame to box, in order; errors begin with the place after the track."""
    boxes: dict[int, LabeledBox] = {}
    for element in track:
        if element.tag != "box":
            raise ValueError(f" has a <{element.tag}>; allowed: boxes (rectangles)")
        try:
            frame = as_whole(element.get("frame", ""), "'frame'")
        except ValueError as error:
            raise ValueError(f", <box>: {error}") from error
        try:
            if frame in boxes:
                raise ValueError("it is there twice; allowed: once")
            boxes[frame] = _labeled(element)
        except ValueError as error:
            raise ValueError(f", <box> of frame {frame}: {error}") from error
    return dict(sorted(boxes.items()))


def _labeled(element: ElementTree.Element) -> LabeledBox:
    is_keyframe = _flag(element, "keyframe", default="1")
    if _flag(element, "outside", default="0"):
        return LabeledBox(None, is_keyframe=is_keyframe)
    values = [element.get(name, "") for name in _CORNERS]
    left, top, right, bottom = four_numbers(values, [f"{name!r}" for name in _CORNERS])
    box = (left, top, right - left, bottom - top)
    if rotation := as_number(element.get("rotation", "0"), "'rotation'"):
        center = (left + right) / 2, (top + bottom) / 2
        box = bounding_box_of_rotated(center, box[2:], math.radians(rotation))
    return LabeledBox(
        box, occluded=_flag(element, "occluded", default="0"), is_keyframe=is_keyframe
    )


def _flag(element: ElementTree.Element, name: str, default: str) -> bool:
    text = element.get(name, default)
    if text not in ("0", "1"):
        raise ValueError(f"{name!r} is {text!r}; allowed: 0 or 1")
    return text == "1"
