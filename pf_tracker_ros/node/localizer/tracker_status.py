"""Reads the tracker's `~/status`, the one message that has box, state and covariance together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.stamps import stamp_of

# Rows and columns of the box covariance: center x, center y, width, height.
_AXES = "xywh"
_BOX_KEYS = "box_x", "box_y", "box_width", "box_height"


def read_status(message: DiagnosticArray) -> TrackerFrame:
    """The frame of a status message.

    Raises:
        ValueError: It is not the status of a tracker, or a number in it is not finite.
    """
    if not message.status:
        raise ValueError("the tracker's status is empty; remap pf_tracker/status to its ~/status")
    own, *others = message.status
    values = _values(own)
    try:
        size = values.get("image_width"), values.get("image_height")
        return TrackerFrame(
            stamp=stamp_of(message.header),
            frame_id=message.header.frame_id,
            is_skipped=values["state"] == "skipped",
            state=values["state"],
            selected=int(values.get("selected", "0")),
            image_size=(int(size[0]), int(size[1])) if size[0] and size[1] else None,
            targets=tuple(_target(_values(other)) for other in others),
        )
    except KeyError as error:
        raise ValueError(
            f"the tracker's status has no key {error}; remap pf_tracker/status to the ~/status of "
            "a tracker of this version"
        ) from None


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {item.key: item.value for item in status.values}


def _target(values: Mapping[str, str]) -> ReportedTarget:
    covariance = np.zeros((4, 4))
    for row, one in enumerate(_AXES):
        for column, other in enumerate(_AXES[row:], row):
            # The tracker leaves out the pairs that are independent.
            value = float(values.get(f"covariance_{one}{other}", "0"))
            covariance[row, column] = covariance[column, row] = value
    x, y, width, height = (float(values[key]) for key in _BOX_KEYS)
    target = ReportedTarget(
        id=int(values["id"]),
        label=values["label"],
        state=values["state"],
        confidence=float(values["confidence"]),
        box=(x, y, width, height),
        box_covariance=covariance,
    )
    if not np.isfinite([*target.box, *covariance.ravel(), target.confidence]).all():
        raise ValueError(f"box or covariance of target {target.id} is not finite")
    return target
