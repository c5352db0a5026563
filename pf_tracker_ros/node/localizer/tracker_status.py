"""Reads the tracker's `~/status`, the one message that has box, state and covariance together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.parameters import quoted
from pf_tracker_ros.stamps import stamp_of

# Most targets that are located in a frame, the selected one and the most confident, each in about a
# millisecond: those of a faulty tracker would take the time of all others.
_MAX_TARGETS = 100
# Most that are read: no tracker has so many.
_MAX_READ = 2000
# Largest id and size that messages and images have.
_MAX_WHOLE = 2**31 - 1
_STATES = ("tracking", "occluded", "lost")
# Rows and columns of the box covariance: center x, center y, width, height.
_AXES = "xywh"
_BOX_KEYS = "box_x", "box_y", "box_width", "box_height"


def read_status(message: DiagnosticArray) -> tuple[TrackerFrame, str]:
    """The frame of a status message, and what is wrong with targets that it leaves out.

    Returns:
        The frame with all targets that can be read, and a sentence about the first other one;
        empty if there is none.

    Raises:
        ValueError: It is not the status of a tracker, or a value of the frame cannot be read.
    """
    if not message.status:
        raise ValueError("it is empty; remap pf_tracker/status to the ~/status of a tracker")
    own, *others = message.status
    if len(others) > _MAX_READ:
        raise ValueError(f"it has {len(others)} targets; expected at most {_MAX_READ}")
    values = _values(own)
    targets: list[ReportedTarget] = []
    problem = ""
    for other in others:
        try:
            targets.append(_target(_values(other)))
        except ValueError as error:
            problem = problem or f"'{other.name}' is left out: {error}"
    selected = _whole(values, "selected") if "selected" in values else 0
    if len(targets) > _MAX_TARGETS:
        problem = problem or (
            f"it has {len(targets)} targets; {_MAX_TARGETS} of them are located, the selected one "
            "and the most confident"
        )
        targets.sort(key=lambda one: (one.id != selected, -one.confidence))
        targets = sorted(targets[:_MAX_TARGETS], key=lambda one: one.id)
    has_size = values.get("image_width") and values.get("image_height")
    frame = TrackerFrame(
        stamp=stamp_of(message.header),
        frame_id=message.header.frame_id,
        is_skipped=_text(values, "state") == "skipped",
        state=values["state"],
        selected=selected,
        image_size=(
            (_whole(values, "image_width"), _whole(values, "image_height")) if has_size else None
        ),
        targets=tuple(targets),
    )
    return frame, problem


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {item.key: item.value for item in status.values}


def _target(values: Mapping[str, str]) -> ReportedTarget:
    covariance = np.zeros((4, 4))
    for row, one in enumerate(_AXES):
        for column, other in enumerate(_AXES[row:], row):
            # The tracker leaves out the pairs that are independent.
            key = f"covariance_{one}{other}"
            value = _number(values, key) if key in values else 0.0
            covariance[row, column] = covariance[column, row] = value
    if np.diag(covariance).min() < 0.0:
        raise ValueError("its covariance has a negative variance; expected 0 or more")
    x, y, width, height = (_number(values, key) for key in _BOX_KEYS)
    if min(width, height) <= 0.0:
        raise ValueError(f"its box is {width:g} x {height:g} px; expected positive sides")
    state, confidence = _text(values, "state"), _number(values, "confidence")
    if state not in _STATES:
        raise ValueError(f"state is {quoted(state)}; expected {', '.join(_STATES)}")
    if not 0.0 <= confidence <= 1.0:
        raise ValueError(f"confidence is {confidence:g}; expected 0 to 1")
    return ReportedTarget(
        id=_whole(values, "id"),
        label=_text(values, "label"),
        state=state,
        confidence=confidence,
        box=(x, y, width, height),
        box_covariance=covariance,
    )


def _text(values: Mapping[str, str], key: str) -> str:
    if key not in values:
        raise ValueError(
            f"it has no key '{key}'; remap pf_tracker/status to the ~/status of a tracker of this "
            "version"
        )
    return values[key]


def _number(values: Mapping[str, str], key: str) -> float:
    text = _text(values, key)
    with suppress(ValueError):
        if math.isfinite(number := float(text)):
            return number
    raise ValueError(f"{key} is {quoted(text)}; expected a finite number")


def _whole(values: Mapping[str, str], key: str) -> int:
    text = _text(values, key)
    with suppress(ValueError):
        if 0 <= (number := int(text)) <= _MAX_WHOLE:
            return number
    raise ValueError(f"{key} is {quoted(text)}; expected a whole number from 0 to {_MAX_WHOLE}")
