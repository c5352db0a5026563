"""Positions of rendered walkers from the tracker's boxes, without depth."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from tables import Table
from world_room import (
    CAMERA,
    CAMERA_HEIGHT,
    CAMERA_PITCH,
    Base,
    Path,
    Room,
    RoomFrame,
    Walker,
    circling,
    driving,
)

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.localization.camera_pose import CameraPose, mounted_pose
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.world_tracks import Sensed
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import GroundPlane
from world_parts.tracked import LocatedTracker, TrackedErrors, central_velocities

ROOMS, FRAMES, RATE = 8, 90, 10.0
# Least IoU with the walker, and least share of the walker in sight, of a box that is on it.
ON_TARGET, IN_SIGHT = 0.3, 0.5
_COLORS = (
    ((50, 60, 200), (90, 60, 40)),
    ((170, 140, 60), (60, 60, 60)),
    ((60, 160, 60), (40, 40, 90)),
    ((200, 200, 200), (120, 60, 30)),
)


def walkers_table(on_progress: OnProgress, rooms: int = ROOMS, frames: int = FRAMES) -> Table:
    """Two people in each room, who come near and go away, or walk in circles."""
    errors = TrackedErrors()
    for number in range(rooms):
        room = drawn_room(number)
        rendered = list(room.frames(frames))
        for index in range(len(room.walkers)):
            follow(rendered, index, errors)
            on_progress("walkers", 1)
    headings = ("default, no depth", "frames", "median", "90 %", "NEES", "inside")
    return Table("Rendered walkers by the tracker's boxes", headings, [errors.rows()])


def drawn_room(number: int) -> Room:
    """A room; the robot drives in every second pair of them."""
    generator = np.random.default_rng(number)
    walkers = []
    for index in range(2):
        y = (-1) ** index * generator.uniform(0.5, 1.2)
        if number % 2:
            center = generator.uniform(4.5, 6.0), y
            radius, period = generator.uniform(0.6, 1.3), generator.uniform(8.0, 14.0)
            path = circling(center, radius, period, generator.uniform(0.0, 2.0 * np.pi))
        else:
            far, near = generator.uniform(6.0, 8.0), generator.uniform(2.5, 3.5)
            path = to_and_fro((far, 1.5 * y), (near, y), generator.uniform(12.0, 18.0))
        height = float(np.clip(generator.normal(1.75, 0.07), 1.6, 1.9))
        walkers.append(Walker(path, *_COLORS[(2 * number + index) % len(_COLORS)], height))
    base = driving(0.1, 0.2, float(np.radians(6.0))) if number % 4 > 1 else driving(0.0, 0.2, 0.0)
    return Room(tuple(walkers), base, rate=RATE, seed=number)


def to_and_fro(start: tuple[float, float], end: tuple[float, float], period: float) -> Path:
    """A walk from one place to another and back, in meters and seconds."""

    def path(time: float) -> tuple[float, float]:
        share = (1.0 - np.cos(2.0 * np.pi * time / period)) / 2.0
        return (
            start[0] + share * (end[0] - start[0]),
            start[1] + share * (end[1] - start[1]),
        )

    return path


def follow(frames: Sequence[RoomFrame], index: int, errors: TrackedErrors) -> None:
    """Track a walker from its box in the first frame, and add the errors of its positions."""
    if frames[0].boxes[index] is None:
        return
    tracker = LocatedTracker(frames[0].image, frames[0].boxes[index], 1.0 / RATE, 0)
    positions = np.array([frame.positions[index] for frame in frames])
    velocities = central_velocities(positions, 1.0 / RATE)
    for number, frame in enumerate(frames[1:], start=1):
        sensed = Sensed(CAMERA, camera_pose(frame.base))
        estimate, located = tracker.update(frame.image, sensed)
        true_box = frame.boxes[index]
        if true_box is None or frame.visible[index] < IN_SIGHT or estimate.state != "tracking":
            continue
        if pairwise_iou(np.array([estimate.box]), np.array([true_box]))[0, 0] >= ON_TARGET:
            errors.add(located, sensed, positions[number], velocities[number])


def camera_pose(base: Base) -> CameraPose:
    """The camera on the robot."""
    plane = GroundPlane.from_angles(CAMERA_HEIGHT, CAMERA_PITCH)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, base.yaw]))[0]
    pose = RigidPose(turn, np.array([base.x, base.y, 0.0])) @ mounted_pose(plane)
    return CameraPose(pose, plane, "parameters", "odometry")
