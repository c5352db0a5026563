"""The topics of the localizer, for its node and for bag writers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.messages import DETECTIONS_3D_TYPE, MARKERS_TYPE, MessageFactory
from pf_tracker_ros.world_messages import (
    BEARING_TYPE,
    ODOMETRY_TYPE,
    POSE_TYPE,
    POSE_WITH_COVARIANCE_TYPE,
    WorldTarget,
    bearing_message,
    detections_3d_message,
    odometry_message,
    pose_message,
    pose_with_covariance_message,
    world_markers_message,
)


class Headers(NamedTuple):
    """The headers of a frame's messages.

    Attributes:
        fixed: With the fixed frame.
        image: With the image's frame.
    """

    fixed: Any
    image: Any


class PositionTopic(NamedTuple):
    """A topic of each located frame.

    Attributes:
        name: Below the node's name.
        message_type: As `package/msg/Name`.
        build: Builds the message from `new`, the headers and the frame; None without a message.
    """

    name: str
    message_type: str
    build: Callable[[MessageFactory, Headers, LocatedFrame], Any]


def certain_target(located: LocatedFrame) -> WorldTarget | None:
    """The selected target, where it is sure enough for a robot to act on; else None."""
    selected = located.selected
    return selected.world if selected and not located.silence else None


def _of_selected(
    build: Callable[[MessageFactory, Any, WorldTarget], Any],
) -> Callable[[MessageFactory, Headers, LocatedFrame], Any]:
    def built(new: MessageFactory, headers: Headers, located: LocatedFrame) -> Any:
        target = certain_target(located)
        return build(new, headers.fixed, target) if target else None

    return built


def _bearing(new: MessageFactory, headers: Headers, located: LocatedFrame) -> Any:
    selected = located.selected
    if not selected or not selected.bearing or not selected.has_bearing:
        return None
    return bearing_message(new, headers.image, selected.bearing.direction)


def _detections_3d(new: MessageFactory, headers: Headers, located: LocatedFrame) -> Any:
    if not located.sensed:
        return None
    return detections_3d_message(new, headers.fixed, located.world_targets)


def _markers(new: MessageFactory, headers: Headers, located: LocatedFrame) -> Any:
    if not located.sensed:
        return None
    return world_markers_message(new, headers.fixed, located.world_targets, located.frame.selected)


POSITION_TOPICS = (
    PositionTopic("pose", POSE_TYPE, _of_selected(pose_message)),
    PositionTopic(
        "pose_with_covariance",
        POSE_WITH_COVARIANCE_TYPE,
        _of_selected(pose_with_covariance_message),
    ),
    PositionTopic("odometry", ODOMETRY_TYPE, _of_selected(odometry_message)),
    PositionTopic("bearing", BEARING_TYPE, _bearing),
    PositionTopic("detections_3d", DETECTIONS_3D_TYPE, _detections_3d),
    PositionTopic("markers", MARKERS_TYPE, _markers),
)
