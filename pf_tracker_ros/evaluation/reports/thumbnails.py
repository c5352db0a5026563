"""Small pictures of frames, with the estimate and the truth drawn in, as a page embeds them."""

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
# Of an image so many times the target's longer side is shown, and no less than so many pixels.
_SURROUNDINGS = 3.0
_SMALLEST = 60.0


@dataclass(frozen=True)
class Thumbnail:
    """A frame as a page shows it.

    Attributes:
        frame: Counted from 0.
        caption: What is to be seen.
        width: Pixels.
        height: Pixels.
        data_url: The picture itself, as a `data:` address.
    """

    frame: int
    caption: str
    width: int
    height: int
    data_url: str


def make_thumbnails(
    contents: Sequence[SequenceContent], images: Iterable[tuple[int, NDArray[Any] | None]]
) -> list[dict[int, Thumbnail]]:
    """Make the pictures that a report shows of the targets of one recording.

    Args:
        contents: What there is to draw of each.
        images: Number of a frame, from 0, and its image, in order; read as far as needed.

    Returns:
        For each of the contents, position of a frame in it to its picture; frames without an image
        are missing.
    """
    wanted = [{*content.sampled_frames, *content.worst_frames} for content in contents]
    last = max(
        (content.first + max(own) for content, own in zip(contents, wanted, strict=True)),
        default=-1,
    )
    pictures: list[dict[int, Thumbnail]] = [{} for _ in contents]
    for number, image in images:
        for content, own, found in zip(contents, wanted, pictures, strict=True):
            if number - content.first in own and image is not None:
                found[number - content.first] = _picture(content, number - content.first, image)
        if number >= last:
            break
    return pictures


def _picture(content: SequenceContent, index: int, image: NDArray[Any]) -> Thumbnail:
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
    return Thumbnail(content.first + index, _caption(content, index), *size, data_url)


def _window(width: int, height: int, boxes: list[NDArray[np.float64]]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the part of an image with the boxes and what is about them."""
    if not boxes:
        return 0, 0, width, height
    corners = np.array([[*box[:2], *(box[:2] + box[2:])] for box in boxes])
    near, far = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    largest = max(float(box[2:].max()) for box in boxes)
    side = max(_SURROUNDINGS * largest, 1.2 * float((far - near).max()), _SMALLEST)
    # Four to three, as all of it fits best on a page.
    across, down = min(width, round(side * 4 / 3)), min(height, round(side))
    center = (near + far) / 2
    left = int(np.clip(round(center[0] - across / 2), 0, width - across))
    top = int(np.clip(round(center[1] - down / 2), 0, height - down))
    return left, top, left + across, top + down


def _caption(content: SequenceContent, index: int) -> str:
    parts = [f"frame {content.first + index}", content.states[index]]
    if content.overlaps is not None and not np.isnan(content.overlaps[index]):
        parts.append(f"overlap {content.overlaps[index]:.2f}")
    if not np.isnan(content.confidence[index]):
        parts.append(f"confidence {content.confidence[index]:.2f}")
    return ", ".join(parts)
