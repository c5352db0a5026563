"""Draws a run: as a video with the boxes, and as a map of the ways."""

from __future__ import annotations

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
_TRUE, _ROBOT, _WRONG = (80, 180, 60), (200, 110, 30), (40, 40, 220)
_STATES: dict[str, Color] = {"tracking": (0, 220, 255), "occluded": (255, 80, 200)}
# Pixels in a meter of the map.
_SCALE = 60
_SECONDS = 10.0


class RunVideo:
    """A video of a run: the image with the true box (green) and that of the tracker, and the map.

    Args:
        path: Of an MP4 file.
        layout: The room.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self._map = _walls(layout)
        self._size = CAMERA.height * self._map.shape[1] // self._map.shape[0], CAMERA.height
        size = CAMERA.width + self._size[0] // 2 * 2, CAMERA.height
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
        _rectangle(image, row.true_box, _TRUE, 1)
        _rectangle(image, row.box, _STATES.get(row.state, _GRAY), 2)
        text = f"{row.time:.2f} s  {row.distance:.2f} m  {row.state} {row.confidence:.2f}"
        for line, part in enumerate((text, row.silence[:80], row.doing)):
            _text(image, part, (6, 16 + 16 * line))
        for x, y in others.tolist():
            cv2.circle(scene, _pixel(x, y), 10, _GRAY, -1)
        _draw_poses(scene, row)
        small = cv2.resize(scene, self._size, interpolation=cv2.INTER_AREA)
        width = self._size[0] // 2 * 2
        self._writer.write(np.hstack([image, small[:, :width]]))


def draw_map(path: Path, layout: Layout, rows: Sequence[Row]) -> None:
    """Write a map of a run: robot (blue), person (green), right and wrong poses (dots).

    Args:
        path: Of an image.
        layout: The room.
        rows: All frames.

    Raises:
        OSError: It cannot be written.
    """
    image = _walls(layout)
    for points, color in (
        ([_pixel(row.robot_x, row.robot_y) for row in rows], _ROBOT),
        ([_pixel(row.x, row.y) for row in rows], _TRUE),
    ):
        cv2.polylines(image, [np.array(points)], False, color, 2, cv2.LINE_AA)
    for row in rows:
        if math.isfinite(row.error):
            color = _WRONG if row.error > OFF else _BLACK
            cv2.circle(image, _pixel(row.said_x, row.said_y), 2, color, -1, cv2.LINE_AA)
    for index, row in enumerate(rows):
        if index % round(_SECONDS * RATE) == 0:
            _text(image, f"{row.time:.0f}", _pixel(row.x, row.y))
            _text(image, f"{row.time:.0f}", _pixel(row.robot_x, row.robot_y))
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path} cannot be written")


def _walls(layout: Layout) -> Image:
    width, height = (np.ceil(layout.outline.max(axis=0) + 0.5) * _SCALE).astype(int).tolist()
    image = np.full((height, width, 3), 255, np.uint8)
    for begin, end in layout.walls.tolist():
        cv2.line(image, _pixel(*begin), _pixel(*end), _BLACK, 3, cv2.LINE_AA)
    return image


def _draw_poses(image: Image, row: Row) -> None:
    cv2.circle(image, _pixel(row.x, row.y), 12, _TRUE, -1, cv2.LINE_AA)
    if math.isfinite(row.error):
        cv2.circle(image, _pixel(row.said_x, row.said_y), 6, _WRONG, -1, cv2.LINE_AA)
    robot = _pixel(row.robot_x, row.robot_y)
    cv2.circle(image, robot, 12, _ROBOT, -1, cv2.LINE_AA)
    half = math.atan2(CAMERA.width / 2.0, CAMERA.fx)
    for side in (-half, half):
        angle = row.robot_yaw + side
        end = _pixel(row.robot_x + 2.0 * math.cos(angle), row.robot_y + 2.0 * math.sin(angle))
        cv2.line(image, robot, end, _ROBOT, 2, cv2.LINE_AA)


def _pixel(x: float, y: float) -> tuple[int, int]:
    return round(x * _SCALE), round(y * _SCALE)


def _rectangle(image: Image, box: Box | None, color: Color, thickness: int) -> None:
    if box:
        x, y, width, height = (round(value) for value in box)
        cv2.rectangle(image, (x, y), (x + width, y + height), color, thickness)


def _text(image: Image, text: str, place: tuple[int, int]) -> None:
    for color, thickness in ((_WHITE, 3), (_BLACK, 1)):
        cv2.putText(
            image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, color, thickness, cv2.LINE_AA
        )
