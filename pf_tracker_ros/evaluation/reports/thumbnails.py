"""Thumbnails of frames with estimate and ground truth, for embedding in a page."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.reports.content import SequenceContent
from pf_tracker_ros.overlay import STATE_COLORS, draw_box, draw_overlay

_WIDTH = 320
_QUALITY = 72
_TRUTH = (80, 220, 80)
# Side of the shown part: a multiple of the target's longer side, and at least so many pixels.
_CONTEXT_FACTOR = 3.0
_MIN_SIDE = 60.0


@dataclass(frozen=True)
class FrameThumbnail:
    """A thumbnail of a frame.

    Attributes:
        frame: Number of the frame, from 0.
        caption: Its caption.
        width: Pixels.
        height: Pixels.
        data_url: The JPEG image as a `data:` URL.
    """

    frame: int
    caption: str
    width: int
    height: int
    data_url: str


def make_thumbnails(
    contents: Sequence[SequenceContent], images: Iterable[tuple[int, NDArray[Any] | None]]
) -> list[dict[int, FrameThumbnail]]:
    """Make the thumbnails of a report on the targets of one recording.

    Args:
        contents: The targets.
        images: Number of a frame, from 0, and its image, in order; read as far as needed.

    Returns:
        For each target, index of a frame to its thumbnail; frames without image are omitted.
    """
    needed = [{*content.sampled_frames, *content.worst_frames} for content in contents]
    last = max(
        (content.first + max(indices) for content, indices in zip(contents, needed, strict=True)),
        default=-1,
    )
    thumbnails: list[dict[int, FrameThumbnail]] = [{} for _ in contents]
    for number, image in images:
        for content, indices, own in zip(contents, needed, thumbnails, strict=True):
            index = number - content.first
            if index in indices and image is not None:
                own[index] = _thumbnail(content, index, image)
        if number >= last:
            break
    return thumbnails


def _thumbnail(content: SequenceContent, index: int, image: NDArray[Any]) -> FrameThumbnail:
    canvas = draw_overlay(image, None)
    boxes = [(content.boxes[index], STATE_COLORS.get(content.states[index]))]
    if content.true_boxes is not None:
        boxes.insert(0, (content.true_boxes[index], _TRUTH))
    known = [(box, color) for box, color in boxes if color and np.isfinite(box).all()]
    left, top, right, bottom = _window(canvas.shape[1], canvas.shape[0], [box for box, _ in known])
    canvas = canvas[top:bottom, left:right]
    scale = _WIDTH / canvas.shape[1]
    size = (_WIDTH, max(1, round(canvas.shape[0] * scale)))
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    canvas = cv2.resize(canvas, size, interpolation=interpolation)
    for box, color in known:
        shifted = box - np.array([left, top, 0.0, 0.0])
        draw_box(canvas, shifted * scale, color, 2)
    encoded = cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    data_url = "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode()
    return FrameThumbnail(content.first + index, _caption(content, index), *size, data_url)


def _window(width: int, height: int, boxes: list[NDArray[np.float64]]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of an image part around the boxes, 4:3 where possible."""
    if not boxes:
        return 0, 0, width, height
    corners = np.array([[*box[:2], *(box[:2] + box[2:])] for box in boxes])
    near, far = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    largest = max(float(box[2:].max()) for box in boxes)
    side = max(_CONTEXT_FACTOR * largest, 1.2 * float((far - near).max()), _MIN_SIDE)
    part_width, part_height = min(width, round(side * 4 / 3)), min(height, round(side))
    center = (near + far) / 2
    left = int(np.clip(round(center[0] - part_width / 2), 0, width - part_width))
    top = int(np.clip(round(center[1] - part_height / 2), 0, height - part_height))
    return left, top, left + part_width, top + part_height


def _caption(content: SequenceContent, index: int) -> str:
    parts = [f"frame {content.first + index}", content.states[index]]
    if content.overlaps is not None and not np.isnan(content.overlaps[index]):
        parts.append(f"overlap {content.overlaps[index]:.2f}")
    if not np.isnan(content.confidence[index]):
        parts.append(f"confidence {content.confidence[index]:.2f}")
    return ", ".join(parts)
