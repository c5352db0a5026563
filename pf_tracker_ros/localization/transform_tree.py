"""Transforms between frames from the messages of /tf and /tf_static, without tf2.

Each frame has one parent. The pose of a frame in another one is that in their common ancestor times
the inverse of the other one's there. A transform of /tf is interpolated at the stamp, never
extrapolated.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.sensors import NotYetError, Store
from pf_tracker_ros.localization.stamped_buffer import StampedBuffer
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world_messages import TARGET_FRAME

# Nanoseconds and number of the transforms that are kept of each frame, as in tf2.
_KEPT, _MAX_POSES = 10 * NANOSECONDS, 10_000


class TransformTree(Store):
    """The transforms of a recording.

    Args:
        feed: Where the messages of /tf come from.
    """

    name = "tf"

    def forget(self) -> None:
        """Forget all messages."""
        self._static: dict[str, tuple[str, RigidPose]] = {}
        self._moving: dict[str, tuple[str, StampedBuffer[RigidPose]]] = {}

    def clear(self) -> None:
        """Nothing: after a jump of the time, the buffers forget what was before it themselves."""

    @property
    def are_published(self) -> bool:
        """Whether there are any; the frames of targets do not count, which the localizer makes."""
        children = {*self._static, *self._moving}
        return any(one.rstrip("0123456789_") != TARGET_FRAME for one in children)

    def take(self, stamp: int, frame_id: str, message: Any) -> None:
        """Store a message of /tf; arguments as of `Store.take`, but only `message` counts."""
        valid, refused = _checked(message.transforms)
        for one, parent, child, pose in valid:
            known = self._moving.get(child)
            if known is None or known[0] != parent:
                known = self._moving[child] = parent, StampedBuffer(_KEPT, _MAX_POSES)
            known[1].add(one.stamp, pose)
        if refused:
            raise ValueError(refused)

    def take_static(self, stamp: int, frame_id: str, message: Any) -> None:
        """Store a message of /tf_static; arguments as of `take`."""
        valid, refused = _checked(message.transforms)
        for _, parent, child, pose in valid:
            self._static[child] = parent, pose
        if refused:
            raise ValueError(refused)

    def lookup(self, parent: str, child: str, stamp: int) -> RigidPose:
        """The pose of the frame `child` in `parent`.

        Args:
            parent: Name of the frame in which the pose is given.
            child: Name of the other frame.
            stamp: Nanoseconds; 0 for the latest of a transform that does not change.

        Raises:
            NotYetError: It may still arrive.
            ValueError: There is none.
        """
        if not child:
            raise ValueError(
                "the images have no frame_id, which transforms need; set camera.height"
            )
        parent, child = parent.lstrip("/"), child.lstrip("/")
        of_child, of_parent = self._ancestors(child), self._ancestors(parent)
        common = next((one for one in of_child if one in of_parent), None)
        if common is None:
            raise self._missing(
                f"no transform from {child} to {parent}; record it, set camera.height, or leave "
                "the transforms out (tf= and tf_static=)"
            )
        upward, downward = (
            self._pose_in(common, frames, stamp) for frames in (of_child, of_parent)
        )
        return downward.inverse() @ upward

    def _ancestors(self, frame: str) -> list[str]:
        """A frame and those above it, from the bottom."""
        found = [frame]
        while edge := self._static.get(found[-1]) or self._moving.get(found[-1]):
            if edge[0] in found:
                raise ValueError(f"the transforms above {frame} are a circle: {', '.join(found)}")
            found.append(edge[0])
        return found

    def _pose_in(self, ancestor: str, frames: list[str], stamp: int) -> RigidPose:
        """The pose of the first of some frames in one of its ancestors."""
        pose = RigidPose.identity()
        for frame in frames[: frames.index(ancestor)]:
            static = self._static.get(frame)
            pose = (static[1] if static else self._at(frame, stamp)) @ pose
        return pose

    def _at(self, frame: str, stamp: int) -> RigidPose:
        """The pose of a frame of /tf in its parent at a stamp."""
        parent, buffer = self._moving[frame]
        before, after = buffer.around(stamp or buffer.newest or 0)
        if after is None:
            behind = (stamp - before[0]) / NANOSECONDS if before else 0.0
            raise self._missing(
                f"the transform from {frame} to {parent} ends {behind:.3f} s before the image"
            )
        if before is None:
            ahead = (after[0] - stamp) / NANOSECONDS
            raise ValueError(
                f"the transform from {frame} to {parent} begins {ahead:.3f} s after the image"
            )
        gap = after[0] - before[0]
        return before[1].interpolate(after[1], (stamp - before[0]) / gap if gap else 0.0)

    def _missing(self, reason: str) -> ValueError:
        return (ValueError if self._feed.is_silent else NotYetError)(reason)


def _checked(transforms: Iterable[Any]) -> tuple[list[tuple[Any, str, str, RigidPose]], str]:
    """The valid transforms with their parts, and what is wrong with the others, or ""."""
    valid, refused = [], []
    for one in transforms:
        try:
            valid.append((one, *_parts(one)))
        except ValueError as error:
            refused.append(str(error))
    return valid, "; ".join(refused)


def _parts(transform: Any) -> tuple[str, str, RigidPose]:
    """Parent, child and pose of a geometry_msgs/TransformStamped."""
    parent, child = transform.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
    try:
        return parent, child, RigidPose.of_message(transform.translation, transform.rotation)
    except ValueError as error:
        raise ValueError(f"the transform from {child} to {parent} is invalid: {error}") from None
