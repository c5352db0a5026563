"""Which targets are tracked in a recording: from the command line, a file beside it, or its truth.

A target file `drive.target.yaml` stands beside `drive.mcap`:

    target_box: [293.0, 97.0, 115.0, 82.0]   # x, y, width, height, pixels
    frame: 3                                 # on which it was drawn, counted from 0
    stamp: 1700000000000000000               # of that frame, nanoseconds
    label: car                               # what it is
    recording: drive.mcap                    # in which: the name of its file or folder
    image_size: [768, 576]                   # width and height of its images, pixels

All but `target_box` may be left out; without `frame` and `stamp` it is drawn on the first frame.
Of several targets, each has these in a list `targets`; `recording` and `image_size` may stand
beside that, for all of them.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import Any

from pf_tracker_ros.atomic_files import atomic_write
from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.footage.access import lexists, resolved
from pf_tracker_ros.messages import box_in_single_precision
from pf_tracker_ros.parameters import quoted
from pf_tracker_ros.recordings.errors import REFUSED, WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.yaml_files import YamlError, read_yaml

_KEYS = {"target_box", "frame", "stamp", "label", "recording", "image_size"}
_SHARED_KEYS = {"recording", "image_size"}
# YAML has whole numbers beyond all floats.
_LARGEST = sys.float_info.max


@dataclass(frozen=True)
class Target:
    """What is to be tracked, and from which frame on.

    Attributes:
        box: (x, y, width, height) in pixels; None takes the first true box.
        stamp: Of the frame that the box was drawn on, nanoseconds; 0 where that is unknown.
        frame: Of that frame, counted from 0; None where that is unknown. Without either it is the
            first one.
        image_size: (width, height) of the image that it was drawn on, None where that is unknown.
        source: Where it comes from, for messages.
        label: What it is, or empty.
    """

    box: Box | None
    stamp: int = 0
    frame: int | None = None
    image_size: tuple[int, int] | None = None
    source: str = ""
    label: str = ""

    def box_in(self, frame: RecordedFrame) -> Box | None:
        """The box as the node would be sent it with this frame; None before its frame comes.

        Raises:
            RecordingError: It was drawn on another recording.
        """
        if self.box is None:
            return None if frame.true_box is None else box_in_single_precision(frame.true_box)
        is_before = (
            frame.index < self.frame
            if self.frame is not None
            else self.stamp and frame.stamp < self.stamp
        )
        if is_before:
            return None
        if self.frame not in (None, frame.index) or self.stamp not in (0, frame.stamp):
            raise self.missed()
        if frame.image is None:
            raise RecordingError(f"frame {frame.index}, with the target: {frame.problem}", REFUSED)
        size = (frame.image.shape[1], frame.image.shape[0])
        if self.image_size not in (None, size):
            raise RecordingError(
                f"{self.source} is of images of {_size_text(self.image_size)} px, and these have "
                f"{_size_text(size)} px: it belongs to another recording",
                WRONG_TARGET,
            )
        return box_in_single_precision(self.box)

    def missed(self) -> RecordingError:
        """The error of a recording that has not the frame that the target was drawn on."""
        if self.box is None:
            return RecordingError(
                "there is no true box in any frame; write a target file beside the recording, or "
                "give --box x,y,w,h where it is tracked alone"
            )
        known = [f"number {self.frame}"] if self.frame is not None else []
        known += [f"stamped {self.stamp} ns"] if self.stamp else []
        return RecordingError(
            f"{self.source} is of a frame {', '.join(known)}, which this recording does not "
            "have: it belongs to another recording",
            WRONG_TARGET,
        )


def choose_target(recording: Recording, box: Sequence[float] | None) -> Target:
    """The one target of a recording: the box that is given, else its target file, else its truth.

    Args:
        recording: What is to be tracked.
        box: (x, y, width, height) in the first frame, in pixels.

    Raises:
        RecordingError: There is none, there are several, or the target file is wrong or of another
            recording.
    """
    first, *others = choose_targets(recording, () if box is None else (box,))
    if others:
        raise RecordingError(
            f"{target_file(recording.path)} lists {1 + len(others)} targets; allowed here: one, as "
            "several are for the command track and the console",
            WRONG_TARGET,
        )
    return first


def choose_targets(
    recording: Recording,
    boxes: Sequence[Sequence[float]] = (),
    *,
    with_detector: bool = False,
    is_archived: bool = False,
) -> tuple[Target, ...]:
    """The targets of a recording: the boxes that are given, else its target file, else its truth.

    Args:
        recording: What is to be tracked.
        boxes: (x, y, width, height) in the first frame, in pixels.
        with_detector: Whether a detector starts targets: then there need be no other, and the truth,
            which is of one target, is none.
        is_archived: Whether it is one of an archive, for what is advised where there is none.

    Raises:
        RecordingError: There is none, or the target file is wrong or of another recording.
    """
    if boxes:
        return tuple(Target(as_box(box), source="--box") for box in boxes)
    path = target_file(recording.path)
    if lexists(path):
        return read_targets(path, recording.path)
    if with_detector:
        return ()
    if recording.has_ground_truth:
        return (Target(None, source="the ground truth"),)
    write = f"write {path.name} beside it"
    advice = f"give --box x,y,w,h for the first frame, or {write}, or draw the target with --draw"
    if is_archived:
        advice = f"{write}, or find targets with --detections, --detections-topic or --detector"
    raise RecordingError(f"no target for {recording.path}: {advice}")


def read_targets(path: Path, source: Path) -> tuple[Target, ...]:
    """Read a target file.

    Args:
        path: The file.
        source: The recording that it stands beside.

    Returns:
        The targets, at least one.

    Raises:
        RecordingError: It cannot be read, is wrong, or names another recording.
    """
    document = _read_yaml(path)
    if "targets" not in document:
        return (_target(path, "", document, source),)
    _check_keys(path, "", document, {"targets", *_SHARED_KEYS})
    entries = document.pop("targets")
    if not isinstance(entries, list) or not entries:
        raise _wrong(path, "'targets'", entries, "a list with a mapping for each target")
    targets = []
    for number, entry in enumerate(entries, start=1):
        of = f" of target {number}"
        if not isinstance(entry, dict):
            raise _wrong(path, f"the entry{of}", entry, "a mapping with target_box, frame, stamp")
        targets.append(_target(path, of, {**document, **entry}, source))
    return tuple(targets)


def _file_text(targets: Sequence[Target], source: Path) -> str:
    texts = [_entry_text(target) for target in targets]
    recording = _yaml_line("recording", resolved(source).name)
    if len(texts) == 1:
        heading = "# A target in the recording beside this file, drawn on a page."
        return f"{heading}\n{texts[0]}{recording}"
    entries = "".join(f"- {indent(text, '  ')[2:]}" for text in texts)
    heading = "# Targets in the recording beside this file, drawn on a page."
    return f"{heading}\ntargets:\n{entries}{recording}"


def _entry_text(target: Target) -> str:
    assert target.box is not None
    box = ", ".join(str(float(value)) for value in target.box)
    text = (
        f"target_box: [{box}]  # x, y, width, height, pixels\n"
        f"frame: {target.frame}  # on which it was drawn, counted from 0\n"
        f"stamp: {target.stamp}  # of that frame, nanoseconds\n"
    )
    if target.label:
        text += _yaml_line("label", target.label)
    if target.image_size:
        text += "image_size: [{}, {}]  # width, height, pixels\n".format(*target.image_size)
    return text


def _yaml_line(name: str, value: str) -> str:
    import yaml

    return str(yaml.safe_dump({name: value}, allow_unicode=True, width=math.inf))


def save_targets(targets: Sequence[Target], source: Path, *, may_replace: bool = False) -> Path:
    """Write the target file of a recording, whole or not at all.

    Args:
        targets: At least one, each with a box.
        source: The recording that they are in.
        may_replace: Whether one that is there may be written over; of a link, what it leads to.

    Returns:
        Path of the file.

    Raises:
        OSError: It cannot be written, or there is one that may not be written over, or what is no
            file.
    """
    path = target_file(source)
    with atomic_write(path, may_replace=may_replace) as draft:
        draft.write_text(_file_text(targets, source), encoding="utf-8")
    return path


def _target(path: Path, of: str, document: dict[str, Any], source: Path) -> Target:
    """One target of a file.

    Args:
        path: The file.
        of: Which one, for messages; empty for the only one.
        document: Its keys and values.
        source: As for `read_targets`.
    """
    _check_keys(path, of, document, _KEYS)
    name = document.get("recording")
    if name is not None and name != resolved(source).name:
        raise RecordingError(
            f"{path} is the target of {name!r}, not of {resolved(source).name!r}: draw one for "
            "this recording, or correct 'recording' in it",
            WRONG_TARGET,
        )
    what = f"'target_box'{of}"
    box = _numbers(
        path, what, document.get("target_box"), 4, "four numbers, x, y, width and height in pixels"
    )
    if min(box[2:]) <= 0:
        raise _wrong(path, what, document["target_box"], "a width and height above 0")
    image_size = None
    if (size := document.get("image_size")) is not None:
        what = f"'image_size'{of}"
        allowed = "two numbers, width and height, both whole"
        width, height = _numbers(path, what, size, 2, allowed)
        if not (width.is_integer() and height.is_integer()):
            raise _wrong(path, what, size, allowed)
        image_size = (int(width), int(height))
    return Target(
        as_box(box),
        stamp=_whole(path, of, document, "stamp") or 0,
        frame=_whole(path, of, document, "frame"),
        image_size=image_size,
        source=f"{of.removeprefix(' of ')} of {path}" if of else str(path),
        label=_label(path, of, document.get("label")),
    )


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        document = read_yaml(path, "target file")
    except YamlError as error:
        raise RecordingError(str(error), WRONG_TARGET) from error
    if not isinstance(document, dict):
        raise _wrong(path, "it", document, "a mapping with target_box, frame and stamp")
    return document


def _check_keys(path: Path, of: str, mapping: dict[str, Any], allowed: set[str]) -> None:
    unknown = sorted(str(key) for key in mapping.keys() - allowed)
    if unknown:
        raise RecordingError(
            f"{path} has {', '.join(unknown)}{of}; allowed: {', '.join(sorted(allowed))}",
            WRONG_TARGET,
        )


def _label(path: Path, of: str, value: Any) -> str:
    label = "" if value is None else value
    if not isinstance(label, str):
        raise _wrong(path, f"'label'{of}", value, "one text, such as car or '7'")
    try:
        label.encode("utf-8")
    except UnicodeEncodeError:
        raise _wrong(path, f"'label'{of}", value, "a text of Unicode characters") from None
    return label


def _whole(path: Path, of: str, document: dict[str, Any], name: str) -> int | None:
    value = document.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise _wrong(path, f"'{name}'{of}", value, "a whole number from 0")
    return int(value)


def _numbers(path: Path, what: str, value: Any, count: int, allowed: str) -> list[float]:
    is_list = isinstance(value, list) and len(value) == count
    if not is_list or not all(
        isinstance(one, (int, float)) and not isinstance(one, bool) and abs(one) <= _LARGEST
        for one in value
    ):
        raise _wrong(path, what, value, allowed)
    return [float(one) for one in value]


def _wrong(path: Path, what: str, value: Any, allowed: str) -> RecordingError:
    return RecordingError(f"{path}: {what} is {quoted(value)}; allowed: {allowed}", WRONG_TARGET)


def _size_text(size: tuple[int, int] | None) -> str:
    return "{} x {}".format(*size) if size else ""
