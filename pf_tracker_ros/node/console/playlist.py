"""The recordings that the page offers, and the tour: what to try with each of them.

A tour is a YAML file with an entry for each recording, in the order of the page:

    - recording: hidden/hidden.mcap        # relative to the folder of the tour
      title: A person
      target: [42, 188, 44, 132]           # box to suggest in the first frame, pixels
      speed: 0.25                          # to play at, relative to the recording's own
      parameters: {max_targets: 8}         # of the tracker, set by the page
      steps:                               # what to try, one at a time
        - Drag a box around the person in red.
        - text: Does a smaller window help?
          parameters: {correlation_response.window: 2.5}   # set by a button of the step

Only `recording` is required.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.node.console.requests import is_number
from pf_tracker_ros.parameters import quoted
from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.yaml_files import YamlError, read_yaml

_KEYS = ("recording", "title", "target", "speed", "parameters", "steps")
_STEP_KEYS = ("text", "parameters")


@dataclass(frozen=True)
class ListedRecording:
    """A recording that the page offers.

    Attributes:
        source: As the parameter `source` of the console.
        title: For the page; empty for the file's name.
        target: (x, y, width, height) to suggest in the first frame, pixels; empty without one.
        speed: To play at, relative to the recording's own; None to keep the present one.
        parameters: Values of the tracker's parameters for this recording.
        steps: What to try: a text and the values of parameters to try each.
    """

    source: str
    title: str = ""
    target: tuple[float, ...] = ()
    speed: float | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    steps: tuple[tuple[str, Mapping[str, Any]], ...] = ()

    @property
    def path(self) -> Path:
        """Path of the recording."""
        return Path(self.source).resolve()


def list_recordings(source: str, others: Sequence[str], tour: str) -> list[ListedRecording]:
    """The recordings to offer: those of the tour in its order, then all others.

    Args:
        source: The first recording to play, or empty.
        others: Further recordings.
        tour: Path of the tour file, or empty.

    Raises:
        RecordingError: The tour is no valid tour.
    """
    listed = read_tour(Path(tour)) if tour else []
    for one in (source, *others):
        entry = ListedRecording(one)
        if one and entry.path not in [known.path for known in listed]:
            listed.append(entry)
    return listed


def recordings_to_json(listed: Sequence[ListedRecording]) -> list[Json]:
    """The recordings for the page; those of the same name are told apart by their folders."""
    counts = Counter(one.path.name for one in listed)
    return [
        {
            "title": one.title
            or (one.path.name if counts[one.path.name] == 1 else "/".join(one.path.parts[-2:])),
            "target": one.target or None,
            "parameters": one.parameters,
            "steps": [{"text": text, "parameters": values} for text, values in one.steps],
        }
        for one in listed
    ]


def read_tour(path: Path) -> list[ListedRecording]:
    """Read a tour file.

    Raises:
        RecordingError: It cannot be read or is invalid.
    """
    try:
        document = read_yaml(path, "tour")
    except YamlError as error:
        raise RecordingError(str(error)) from error
    if not isinstance(document, list) or not document:
        raise _invalid(path, "the document", document, "a list with an entry for each recording")
    return [
        _recording(path, f" of entry {number}", entry)
        for number, entry in enumerate(document, start=1)
    ]


def _recording(path: Path, which: str, entry: Any) -> ListedRecording:
    if not isinstance(entry, dict):
        raise _invalid(path, f"the content{which}", entry, f"a mapping with {', '.join(_KEYS)}")
    _check_keys(path, which, entry, _KEYS)
    recording, title, speed = (entry.get(name) for name in ("recording", "title", "speed"))
    if not isinstance(recording, str) or not recording or "\0" in recording:
        raise _invalid(path, f"'recording'{which}", recording, "the path of a recording")
    if not isinstance(title, str | None):
        raise _invalid(path, f"'title'{which}", title, "a text")
    if speed is not None and not (_is_finite(speed) and speed >= 0):
        raise _invalid(path, f"'speed'{which}", speed, "a number from 0 on; 0 is full speed")
    target = entry.get("target", [])
    if (
        not isinstance(target, list)
        or not all(map(_is_finite, target))
        or len(target) not in (0, 4)
        or not all(side > 0 for side in target[2:])
    ):
        allowed = "4 numbers: x, y, width, height; width and height above 0"
        raise _invalid(path, f"'target'{which}", target, allowed)
    steps = entry.get("steps", [])
    if not isinstance(steps, list):
        raise _invalid(path, f"'steps'{which}", steps, "a list of texts")
    return ListedRecording(
        str(path.parent / recording),
        title or "",
        tuple(map(float, target)),
        speed,
        _parameters(path, which, entry),
        tuple(_step(path, f" of step {n}{which}", one) for n, one in enumerate(steps, start=1)),
    )


def _step(path: Path, which: str, step: Any) -> tuple[str, Mapping[str, Any]]:
    entry = step if isinstance(step, dict) else {"text": step}
    _check_keys(path, which, entry, _STEP_KEYS)
    text = entry.get("text")
    if not isinstance(text, str) or not text.strip():
        raise _invalid(path, f"the text{which}", text, "a text")
    return " ".join(text.split()), _parameters(path, which, entry)


def _parameters(path: Path, which: str, entry: Mapping[str, Any]) -> Mapping[str, Any]:
    values = entry.get("parameters", {})
    if not isinstance(values, dict) or not all(
        isinstance(name, str) and (isinstance(value, bool | str) or _is_finite(value))
        for name, value in values.items()
    ):
        allowed = "a mapping of parameters of the tracker to a number, a text, true or false each"
        raise _invalid(path, f"'parameters'{which}", values, allowed)
    return values


def _is_finite(value: Any) -> bool:
    # An integer of YAML may be too large for a floating-point number.
    return is_number(value) and abs(value) <= sys.float_info.max


def _check_keys(path: Path, which: str, entry: Mapping[Any, Any], known: Sequence[str]) -> None:
    for key in entry:
        if key not in known:
            raise _invalid(path, f"a key{which}", key, ", ".join(known))


def _invalid(path: Path, what: str, value: Any, allowed: str) -> RecordingError:
    return RecordingError(f"{path}: {what} is {quoted(value)}; allowed: {allowed}")
