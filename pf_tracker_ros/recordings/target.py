"""The targets of a recording: from the command line, its target file or its ground truth.

The target file `drive.target.yaml` stands beside `drive.mcap`:

    target_box: [293.0, 97.0, 115.0, 82.0]   # x, y, width, height, pixels
    frame: 3                                 # on which it was drawn, counted from 0
    stamp: 1700000000000000000               # of that frame, nanoseconds
    label: car                               # class or name
    recording: drive.mcap                    # name of its file or folder
    image_size: [768, 576]                   # width, height, pixels

Only `target_box` is required. Without `frame` and `stamp` the box is in the first frame. Several
targets stand in a list `targets`, with these keys each. `recording` and `image_size` may also
stand beside the list.

A target may have boxes in several frames, for `track --keyframes`; they replace `target_box`,
`frame` and `stamp`. `absent` means that the target is absent from there to the next keyframe:

    keyframes:
    - {frame: 3, box: [293.0, 97.0, 115.0, 82.0]}
    - {frame: 60, absent: true}
    - {frame: 71, box: [310.0, 95.0, 116.0, 83.0]}
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

_KEYS = {"target_box", "frame", "stamp", "label", "recording", "image_size", "keyframes"}
_REPLACED_KEYS = {"target_box", "frame", "stamp"}
_SHARED_KEYS = {"recording", "image_size"}
# YAML integers are unbounded.
_MAX_FLOAT = sys.float_info.max


@dataclass(frozen=True)
class Target:
    """A target to track, and the frame of its first box.

    Attributes:
        box: (x, y, width, height) in pixels; None means the first true box.
        stamp: Of the frame of the box, nanoseconds; 0 if unknown.
        frame: Index of this frame, counted from 0; None if unknown. Without `stamp` and `frame` it
            is the first frame.
        image_size: (width, height) of the image, None if unknown.
        source: Where the target comes from, for messages.
        label: Class or name, or empty.
        keyframes: Frame and box of each, in order; None where the target is absent. If there are
            any, `box` and `frame` are those of the first one with a box.
    """

    box: Box | None
    stamp: int = 0
    frame: int | None = None
    image_size: tuple[int, int] | None = None
    source: str = ""
    label: str = ""
    keyframes: tuple[tuple[int, Box | None], ...] = ()

    def box_in(self, frame: RecordedFrame) -> Box | None:
        """The box in single precision, as in a message to the node; None before its frame.

        Raises:
            RecordingError: The target belongs to another recording.
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
            raise self.not_found_error()
        if frame.image is None:
            raise RecordingError(f"frame {frame.index}, with the target: {frame.problem}", REFUSED)
        size = (frame.image.shape[1], frame.image.shape[0])
        if self.image_size not in (None, size):
            raise RecordingError(
                f"{self.source} is for images of {_size_text(self.image_size)} px, but these have "
                f"{_size_text(size)} px: it belongs to another recording",
                WRONG_TARGET,
            )
        return box_in_single_precision(self.box)

    def not_found_error(self) -> RecordingError:
        """Return the error for a recording without the frame of the target."""
        if self.box is None:
            return RecordingError(
                "the ground truth has no box in any frame; write a target file beside the "
                "recording, or give --box X,Y,W,H for a single recording"
            )
        known = [f"number {self.frame}"] if self.frame is not None else []
        known += [f"stamp {self.stamp} ns"] if self.stamp else []
        return RecordingError(
            f"{self.source} is for the frame with {' and '.join(known)}, which this recording does "
            "not have: it belongs to another recording",
            WRONG_TARGET,
        )


def choose_target(recording: Recording, box: Sequence[float] | None) -> Target:
    """The single target of a recording: the given box, else its target file, else its truth.

    Args:
        recording: To track in.
        box: (x, y, width, height) in the first frame, in pixels, or None.

    Raises:
        RecordingError: There is no target or more than one, or the target file is invalid or
            belongs to another recording.
    """
    first, *others = choose_targets(recording, () if box is None else (box,))
    if others:
        raise RecordingError(
            f"{target_file(recording.path)} lists {1 + len(others)} targets; allowed here: one "
            "(the command track and the console take several)",
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
    """The targets of a recording: the given boxes, else its target file, else its truth.

    Args:
        recording: To track in.
        boxes: (x, y, width, height) in the first frame, in pixels.
        with_detector: Whether a detector starts targets. Then none are required, and the truth,
            which has a single target, is not used.
        is_archived: Whether the recording belongs to an archive; changes the advice in errors.

    Returns:
        The targets; empty only with a detector.

    Raises:
        RecordingError: There is no target, or the target file is invalid or belongs to another
            recording.
    """
    if boxes:
        return tuple(Target(as_box(box), source="--box") for box in boxes)
    path = target_file(recording.path)
    if not recording.is_live and lexists(path):
        return read_targets(path, recording.path)
    if with_detector:
        return ()
    if recording.is_live:
        raise RecordingError(
            f"no target for {recording.path}; draw it with --draw, give --box X,Y,W,H, or find "
            "targets with --detector"
        )
    if recording.has_ground_truth:
        return (Target(None, source="the ground truth"),)
    write = f"write {path.name} beside it"
    advice = (
        f"give --box X,Y,W,H for the first frame, draw it with --draw, find targets with "
        f"--detector, or {write}"
    )
    if is_archived:
        advice = f"{write}, or detect targets with --detections, --detections-topic or --detector"
    raise RecordingError(f"no target for {recording.path}; {advice}")


def read_targets(path: Path, source: Path) -> tuple[Target, ...]:
    """Read a target file.

    Returns:
        The targets, at least one.

    Raises:
        RecordingError: It cannot be read, is invalid, or names another recording.
    """
    document = _read_yaml(path)
    if "targets" not in document:
        return (_target(path, "", document, source),)
    _check_keys(path, "", document, {"targets", *_SHARED_KEYS})
    entries = document.pop("targets")
    if not isinstance(entries, list) or not entries:
        raise _invalid(path, "'targets'", entries, "a list with a mapping for each target")
    targets = []
    for number, entry in enumerate(entries, start=1):
        which = f" of target {number}"
        if not isinstance(entry, dict):
            allowed = "a mapping with target_box, frame, stamp"
            raise _invalid(path, f"the entry{which}", entry, allowed)
        targets.append(_target(path, which, {**document, **entry}, source))
    return tuple(targets)


def file_text(targets: Sequence[Target], source: Path, origin: str = "drawn on a page") -> str:
    """The text of a target file.

    Args:
        targets: At least one, each with a box.
        source: Path of the recording.
        origin: Where the targets come from, for its first line.
    """
    texts = [_entry_text(target) for target in targets]
    recording = _yaml_line("recording", resolved(source).name)
    if len(texts) == 1:
        heading = f"# A target in the recording beside this file, {origin}."
        return f"{heading}\n{texts[0]}{recording}"
    entries = "".join(f"- {indent(text, '  ')[2:]}" for text in texts)
    heading = f"# Targets in the recording beside this file, {origin}."
    return f"{heading}\ntargets:\n{entries}{recording}"


def _entry_text(target: Target) -> str:
    assert target.box is not None
    if target.keyframes:
        lines = [
            f"- {{frame: {frame}, {_box_text(box) if box else 'absent: true'}}}\n"
            for frame, box in target.keyframes
        ]
        text = f"keyframes:  # box: x, y, width, height, pixels; frames from 0\n{''.join(lines)}"
    else:
        text = (
            f"target_{_box_text(target.box)}  # x, y, width, height, pixels\n"
            f"frame: {target.frame}  # on which it was drawn, counted from 0\n"
            f"stamp: {target.stamp}  # of that frame, nanoseconds\n"
        )
    if target.label:
        text += _yaml_line("label", target.label)
    if target.image_size:
        text += "image_size: [{}, {}]  # width, height, pixels\n".format(*target.image_size)
    return text


def _box_text(box: Box) -> str:
    return f"box: [{', '.join(str(float(value)) for value in box)}]"


def _yaml_line(name: str, value: str) -> str:
    import yaml

    return str(yaml.safe_dump({name: value}, allow_unicode=True, width=math.inf))


def save_targets(targets: Sequence[Target], source: Path, *, may_replace: bool = False) -> Path:
    """Write the target file of a recording atomically.

    Args:
        targets: At least one, each with a box.
        source: Path of the recording.
        may_replace: Whether an existing file may be replaced; for a link, the file it points to.

    Returns:
        Path of the file.

    Raises:
        OSError: It cannot be written, or it exists and may not be replaced, or is not a file.
    """
    path = target_file(source)
    with atomic_write(path, may_replace=may_replace) as draft:
        draft.write_text(file_text(targets, source), encoding="utf-8")
    return path


def _target(path: Path, which: str, document: dict[str, Any], source: Path) -> Target:
    """One target of a file; `which` names it in messages, such as " of target 2", or is empty."""
    _check_keys(path, which, document, _KEYS)
    recording = document.get("recording")
    if recording is not None and recording != resolved(source).name:
        raise RecordingError(
            f"{path} is for {recording!r}, not for {resolved(source).name!r}; draw a target in "
            "this recording, or correct 'recording' in the file",
            WRONG_TARGET,
        )
    keyframes = _keyframes(path, which, document)
    frame: int | None
    if keyframes:
        frame, box = next((frame, box) for frame, box in keyframes if box is not None)
    else:
        frame = _whole_number(path, which, document, "frame")
        box = _box(path, f"'target_box'{which}", document.get("target_box"))
    image_size = None
    if (size := document.get("image_size")) is not None:
        name = f"'image_size'{which}"
        allowed = "two whole numbers, width and height"
        width, height = _numbers(path, name, size, 2, allowed)
        if not (width.is_integer() and height.is_integer()):
            raise _invalid(path, name, size, allowed)
        image_size = (int(width), int(height))
    return Target(
        box,
        stamp=_whole_number(path, which, document, "stamp") or 0,
        frame=frame,
        image_size=image_size,
        source=f"{which.removeprefix(' of ')} of {path}" if which else str(path),
        label=_label(path, which, document.get("label")),
        keyframes=keyframes,
    )


def _keyframes(
    path: Path, which: str, document: dict[str, Any]
) -> tuple[tuple[int, Box | None], ...]:
    """The keyframes of a target, in order of their frames; empty without any."""
    if "keyframes" not in document:
        return ()
    if replaced := sorted(_REPLACED_KEYS & document.keys()):
        raise RecordingError(
            f"{path}: 'keyframes'{which} replaces {', '.join(replaced)}; remove one or the other",
            WRONG_TARGET,
        )
    entries = document["keyframes"]
    allowed = "a list of {frame: 3, box: [x, y, width, height]} or {frame: 3, absent: true}"
    if not isinstance(entries, list):
        raise _invalid(path, f"'keyframes'{which}", entries, allowed)
    keyframes: dict[int, Box | None] = {}
    for number, entry in enumerate(entries, start=1):
        place = f" of keyframe {number}{which}"
        if not isinstance(entry, dict) or entry.keys() not in (
            {"frame", "box"},
            {"frame", "absent"},
        ):
            raise _invalid(path, f"the entry{place}", entry, allowed)
        frame = _whole_number(path, place, entry, "frame")
        if frame is None or frame in keyframes:
            raise _invalid(path, f"'frame'{place}", frame, "a frame without another keyframe")
        if entry.get("absent", True) is not True:
            raise _invalid(path, f"'absent'{place}", entry["absent"], "true, or a box instead")
        keyframes[frame] = _box(path, f"'box'{place}", entry["box"]) if "box" in entry else None
    if not any(keyframes.values()):
        raise _invalid(path, f"'keyframes'{which}", entries, "at least one with a box")
    return tuple(sorted(keyframes.items()))


def _box(path: Path, name: str, value: Any) -> Box:
    box = _numbers(path, name, value, 4, "four numbers, x, y, width and height in pixels")
    if min(box[2:]) <= 0:
        raise _invalid(path, name, value, "a width and height above 0")
    return as_box(box)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        document = read_yaml(path, "target file")
    except YamlError as error:
        raise RecordingError(str(error), WRONG_TARGET) from error
    if not isinstance(document, dict):
        raise _invalid(path, "the document", document, "a mapping with target_box, frame and stamp")
    return document


def _check_keys(path: Path, which: str, mapping: dict[str, Any], allowed: set[str]) -> None:
    unknown = sorted(str(key) for key in mapping.keys() - allowed)
    if unknown:
        raise RecordingError(
            f"{path}: unknown key {', '.join(unknown)}{which}; allowed: "
            f"{', '.join(sorted(allowed))}",
            WRONG_TARGET,
        )


def _label(path: Path, which: str, value: Any) -> str:
    label = "" if value is None else value
    if not isinstance(label, str):
        raise _invalid(path, f"'label'{which}", value, "a text, such as car or '7'")
    try:
        label.encode("utf-8")
    except UnicodeEncodeError:
        raise _invalid(path, f"'label'{which}", value, "Unicode text") from None
    return label


def _whole_number(path: Path, which: str, document: dict[str, Any], name: str) -> int | None:
    value = document.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise _invalid(path, f"'{name}'{which}", value, "a whole number from 0")
    return int(value)


def _numbers(path: Path, name: str, value: Any, count: int, allowed: str) -> list[float]:
    is_list = isinstance(value, list) and len(value) == count
    if not is_list or not all(
        isinstance(one, (int, float)) and not isinstance(one, bool) and abs(one) <= _MAX_FLOAT
        for one in value
    ):
        raise _invalid(path, name, value, allowed)
    return [float(one) for one in value]


def _invalid(path: Path, name: str, value: Any, allowed: str) -> RecordingError:
    return RecordingError(f"{path}: {name} is {quoted(value)}; allowed: {allowed}", WRONG_TARGET)


def _size_text(size: tuple[int, int] | None) -> str:
    return "{} x {}".format(*size) if size else ""
