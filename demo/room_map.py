"""The room of the robot that follows a person, seen from above."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import cv2
import numpy as np
from follow_parts.layout import Layout
from follow_parts.metrics import Row
from follow_parts.rendering import CAMERA
from numpy.typing import ArrayLike, NDArray

Color = tuple[int, int, int]

_BLACK, _GRAY = (0, 0, 0), (160, 160, 160)
PERSON_COLOR, ROBOT_COLOR, POSE_COLOR = (80, 180, 60), (200, 110, 30), (40, 40, 220)
"""Blue, green, red of what the map shows."""
# Pixels in a meter of the map.
_SCALE = 60


class RoomMap:
    """The walls of a room, seen from above; pixels of its image.

    Args:
        layout: Walls of the room.

    Attributes:
        image: (H, W, 3) BGR.
    """

    def __init__(self, layout: Layout) -> None:
        width, self._height = (layout.outline.max(axis=0) + 0.5).tolist()
        shape = math.ceil(self._height * _SCALE), math.ceil(width * _SCALE), 3
        self.image = np.full(shape, 255, np.uint8)
        for begin, end in layout.walls.tolist():
            self.line([begin, end], _BLACK, 3)

    def copy(self) -> RoomMap:
        """One to draw on."""
        copied = copy.copy(self)
        copied.image = self.image.copy()
        return copied

    def place(self, x: float, y: float) -> tuple[int, int]:
        """Pixel of a point of the room."""
        return round(x * _SCALE), round((self._height - y) * _SCALE)

    def line(self, points: Sequence[ArrayLike], color: Color, thickness: int = 2) -> None:
        """Draw the line through some points."""
        pixels = np.array([self.place(x, y) for x, y in points])
        cv2.polylines(self.image, [pixels], False, color, thickness, cv2.LINE_AA)

    def dot(self, x: float, y: float, radius: int, color: Color) -> None:
        """Draw a point; nothing where it is nan."""
        if math.isfinite(x):
            cv2.circle(self.image, self.place(x, y), radius, color, -1, cv2.LINE_AA)

    def people(self, row: Row, others: NDArray[np.float64]) -> None:
        """Draw the robot with its field of view, the person, the pose and the others.

        Args:
            row: Of the frame.
            others: (N, 2) positions of the others, meters.
        """
        for x, y in others.tolist():
            self.dot(x, y, 10, _GRAY)
        x, y, half = row.robot.x, row.robot.y, math.atan2(CAMERA.width / 2.0, CAMERA.fx)
        sides = [row.robot.yaw + half, row.robot.yaw - half]
        left, right = ([x + 2 * math.cos(side), y + 2 * math.sin(side)] for side in sides)
        self.line([left, [x, y], right], ROBOT_COLOR)
        self.dot(x, y, 12, ROBOT_COLOR)
        self.dot(*row.person.tolist(), 12, PERSON_COLOR)
        self.dot(*row.said.tolist(), 6, POSE_COLOR)
