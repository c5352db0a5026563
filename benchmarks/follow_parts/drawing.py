"""Draws a run: as a video with the boxes, and as a map of the ways."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from follow_parts.layout import Layout
from follow_parts.metrics import OFF, Row
from follow_parts.rendering import CAMERA
from follow_parts.world import RATE
from pf_tracker_ros.boxes import Box

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

_WHITE, _BLACK, _GRAY = (255, 255, 255), (0, 0, 0), (160, 160, 160)
PERSON_COLOR, ROBOT_COLOR, POSE_COLOR = (80, 180, 60), (200, 110, 30), (40, 40, 220)
"""Blue, green, red of what the map shows; of poses, those that are off."""
_STATES: dict[str, Color] = {"tracking": (0, 220, 255), "occluded": (255, 80, 200)}
# Pixels in a meter of the map.
_SCALE = 60
_SECONDS = 10.0


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

    def line(self, points: Sequence[Sequence[float]], color: Color, thickness: int = 2) -> None:
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
        x, y, half = row.robot_x, row.robot_y, math.atan2(CAMERA.width / 2.0, CAMERA.fx)
        sides = [row.robot_yaw + half, row.robot_yaw - half]
        left, right = ([x + 2 * math.cos(side), y + 2 * math.sin(side)] for side in sides)
        self.line([left, [x, y], right], ROBOT_COLOR)
        self.dot(x, y, 12, ROBOT_COLOR)
        self.dot(row.x, row.y, 12, PERSON_COLOR)
        self.dot(row.said_x, row.said_y, 6, POSE_COLOR)


class RunVideo:
    """A video of a run: the image with the true box (green) and that of the tracker, and the map.

    Args:
        path: Of an MP4 file.
        layout: The room.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self._map = RoomMap(layout)
        rows, columns = self._map.image.shape[:2]
        self._size = CAMERA.height * columns // rows // 2 * 2, CAMERA.height
        size = CAMERA.width + self._size[0], CAMERA.height
        code = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(path), code, RATE, size)
        if not self._writer.isOpened():
            raise OSError(f"{path} cannot be written as MP4")

    def __enter__(self) -> RunVideo:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._writer.release()

    def add(self, image: Image, row: Row, others: NDArray[np.float64]) -> None:
        """Add a frame.

        Args:
            image: What the camera saw.
            row: Of the frame.
            others: (N, 2) positions of the others, meters.
        """
        image, scene = image.copy(), self._map.copy()
        _rectangle(image, row.true_box, PERSON_COLOR, 1)
        _rectangle(image, row.box, _STATES.get(row.state, _GRAY), 2)
        text = f"{row.time:.2f} s  {row.distance:.2f} m  {row.state} {row.confidence:.2f}"
        for line, part in enumerate((text, row.silence[:80], row.doing)):
            _text(image, part, (6, 16 + 16 * line))
        scene.people(row, others)
        small = cv2.resize(scene.image, self._size, interpolation=cv2.INTER_AREA)
        self._writer.write(np.hstack([image, small]))


def draw_map(path: Path, layout: Layout, rows: Sequence[Row]) -> None:
    """Write a map of a run: robot (blue), person (green), right and wrong poses (dots).

    Args:
        path: Of an image.
        layout: The room.
        rows: All frames.

    Raises:
        OSError: It cannot be written.
    """
    scene = RoomMap(layout)
    scene.line([(row.robot_x, row.robot_y) for row in rows], ROBOT_COLOR)
    scene.line([(row.x, row.y) for row in rows], PERSON_COLOR)
    for row in rows:
        scene.dot(row.said_x, row.said_y, 2, POSE_COLOR if row.error > OFF else _BLACK)
    for row in rows[:: round(_SECONDS * RATE)]:
        for x, y in ((row.x, row.y), (row.robot_x, row.robot_y)):
            _text(scene.image, f"{row.time:.0f}", scene.place(x, y))
    if not cv2.imwrite(str(path), scene.image):
        raise OSError(f"{path} cannot be written")


def _rectangle(image: Image, box: Box | None, color: Color, thickness: int) -> None:
    if box:
        x, y, width, height = (round(value) for value in box)
        cv2.rectangle(image, (x, y), (x + width, y + height), color, thickness)


def _text(image: Image, text: str, place: tuple[int, int]) -> None:
    for color, thickness in ((_WHITE, 3), (_BLACK, 1)):
        cv2.putText(
            image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, color, thickness, cv2.LINE_AA
        )
