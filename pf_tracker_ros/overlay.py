"""The overlay: estimate, particles and state drawn into the image.

Source: Li et al. 2007, figures: a large white box for the estimate, small white boxes for the
particles. A particle's position shows its state, its size its weight.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.exposure import range_of, sample, to_8_bit
from pf_tracker_ros.tracking.estimate import Estimate

if TYPE_CHECKING:
    from pf_tracker_ros.targets.tracked_target import TrackedTarget

Color = tuple[int, int, int]

STATE_COLORS: dict[str, Color] = {
    "tracking": (255, 255, 255),
    "occluded": (0, 165, 255),
    "lost": (0, 0, 255),
}
_OUTLINE: Color = (0, 0, 0)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
# Image height in the paper, pixels; the sizes below are for it.
_NOMINAL_HEIGHT = 576.0
_PARTICLE_SIDES = (2.0, 10.0)
_FONT_SCALE = 0.7
# Hue difference of successive ids, the golden angle as a fraction of a turn: near ids differ well.
_HUE_STEP = 0.381966
# Pixels; screens show no more of a wider picture.
_MAX_WIDTH = 1920
_QUALITY = 90


def draw_tracked(
    image: NDArray[Any],
    targets: Sequence[TrackedTarget],
    selected: int = 0,
    *,
    multi_target: bool = False,
) -> NDArray[Any]:
    """Draw the tracker's output into a copy of the image.

    Args:
        image: (H, W, 3) uint8 BGR, or (H, W) uint8, uint16 or float32.
        targets: All tracked targets.
        selected: Id of the target with the thicker box, 0 for none.
        multi_target: Whether the tracker may have several targets. Each then has its own color.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    if multi_target:
        return draw_multi_target(image, targets, selected)
    estimate = targets[0].estimate if targets else None
    text = f"{estimate.state} {estimate.confidence:.2f}" if estimate else "no target"
    return draw_overlay(image, estimate, text)


def draw_overlay(image: NDArray[Any], estimate: Estimate | None, text: str = "") -> NDArray[Any]:
    """Draw a single target into a copy of the image, as in the figures of the paper.

    Args:
        image: As for `draw_tracked`.
        estimate: Drawn as a large box in the color of its state. A particle is a small square
            whose side grows with its weight. None draws the text alone.
        text: Caption at the top left.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    canvas = _canvas(image)
    scale = max(canvas.shape[0] / _NOMINAL_HEIGHT, 0.5)
    thickness = max(1, round(2 * scale))
    color = STATE_COLORS["tracking"]
    if estimate is not None:
        color = STATE_COLORS[estimate.state]
        _draw_boxes(canvas, _particle_boxes(estimate, scale), STATE_COLORS["tracking"], 1)
        draw_box(canvas, np.array(estimate.box), color, thickness)
    if text:
        _write(canvas, text, (round(8 * scale), round(24 * scale)), color, scale)
    return canvas


def draw_multi_target(
    image: NDArray[Any], targets: Sequence[TrackedTarget], selected: int = 0
) -> NDArray[Any]:
    """Draw several targets into a copy of the image, each in the color of its id.

    Args:
        image: As for `draw_tracked`.
        targets: Drawn with particles, box, id and label. Occluded and lost targets have a thin box.
        selected: As for `draw_tracked`.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    canvas = _canvas(image)
    scale = max(canvas.shape[0] / _NOMINAL_HEIGHT, 0.5)
    thickness = max(1, round(2 * scale))
    for target in targets:
        particles = _particle_boxes(target.estimate, 0.5 * scale)
        _draw_boxes(canvas, particles, target_color(target.id), 1)
    for target in targets:
        width = thickness if target.estimate.state == "tracking" else 1
        width += thickness if target.id == selected else 0
        draw_box(canvas, np.array(target.estimate.box), target_color(target.id), width)
    _write_captions(canvas, targets, scale)
    return canvas


def draw_box(canvas: NDArray[Any], box: NDArray[np.float64], color: Color, thickness: int) -> None:
    """Draw a (4,) box into a BGR image, with a dark outline of one pixel on both sides."""
    _draw_boxes(canvas, box[None], _OUTLINE, thickness + 2)
    _draw_boxes(canvas, box[None], color, thickness)


def _write_captions(
    canvas: NDArray[np.uint8], targets: Sequence[TrackedTarget], scale: float
) -> None:
    """Write id and label above each box and inside the image.

    One that would cover another caption is written above that.
    """
    line, outlined = 20 * scale, max(1, round(1.6 * scale)) + 2
    taken: list[tuple[float, float, float]] = []
    for target in targets:
        text = _drawable(target_caption(target))
        x, y = np.clip(target.estimate.box[:2], 0.0, canvas.shape[1::-1])
        baseline = y - 4 * scale if y > line else y + line
        (width, _), _ = cv2.getTextSize(text, _FONT, 0.8 * _FONT_SCALE * scale, outlined)
        x = max(min(x, canvas.shape[1] - width - outlined), 0.0)
        # From the lowest caption up, so that one step leaves it for good.
        for left, right, other in sorted(taken, key=lambda caption: -caption[2]):
            if x < right and left < x + width and abs(baseline - other) < line:
                baseline = other - line
        taken.append((x, x + width, baseline))
        origin = round(x), round(max(baseline, line))
        _write(canvas, text, origin, target_color(target.id), 0.8 * scale)


def target_color(id: int) -> Color:
    """The color of a target id, (blue, green, red)."""
    hue = id * _HUE_STEP % 1.0
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.75 if id % 2 else 0.55, 1.0)
    return round(255 * blue), round(255 * green), round(255 * red)


def target_caption(target: TrackedTarget) -> str:
    """Id and label of a target."""
    return f"{target.id} {target.label}".rstrip()


def _write(
    canvas: NDArray[Any], text: str, origin: tuple[int, int], color: Color, scale: float
) -> None:
    thickness = max(1, round(2 * scale))
    text = _drawable(text)
    for text_color, width in ((_OUTLINE, thickness + 2), (color, thickness)):
        cv2.putText(
            canvas, text, origin, _FONT, _FONT_SCALE * scale, text_color, width, cv2.LINE_AA
        )


def _drawable(text: str) -> str:
    """The text without what cannot be encoded, on which OpenCV aborts the process."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _canvas(image: NDArray[Any]) -> NDArray[Any]:
    if image.ndim == 3:
        return image.copy()
    if image.dtype != np.uint8:
        # The overlay spans the values of this image, not those of the tracker's frames before.
        values = sample(image)
        image = to_8_bit(image, range_of(values, margin=0.0) if values.size else (0.0, 1.0))
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)


def _particle_boxes(estimate: Estimate, scale: float) -> NDArray[np.float64]:
    """(N, 4) squares at the particles' centers; the side grows with the weight."""
    boxes = estimate.particle_boxes
    smallest, largest = (side * scale for side in _PARTICLE_SIDES)
    share = estimate.weights / estimate.weights.max()
    sides = smallest + (largest - smallest) * share[:, None]
    centers = boxes[:, :2] + boxes[:, 2:] / 2
    return np.hstack([centers - sides / 2, np.repeat(sides, 2, axis=1)])


def _draw_boxes(
    canvas: NDArray[Any], boxes: NDArray[np.float64], color: Color, thickness: int
) -> None:
    height, width = canvas.shape[:2]
    # The last pixel inside [x, x + width). Clipped far outside, as OpenCV takes 32-bit integers.
    left, top = boxes[:, 0], boxes[:, 1]
    right, bottom = left + boxes[:, 2] - 1, top + boxes[:, 3] - 1
    x = np.clip(np.rint([left, right, right, left]), -width, 2 * width)
    y = np.clip(np.rint([top, top, bottom, bottom]), -height, 2 * height)
    corners = np.ascontiguousarray(np.stack([x.T, y.T], axis=-1), dtype=np.int32)
    cv2.polylines(canvas, list(corners), isClosed=True, color=color, thickness=thickness)


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """A picture, (H, W, 3) uint8 BGR, as JPEG for a page; smaller if it is wider than screens."""
    height, width = picture.shape[:2]
    if width > _MAX_WIDTH:
        size = (_MAX_WIDTH, max(1, round(height * _MAX_WIDTH / width)))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return encoded.tobytes()
