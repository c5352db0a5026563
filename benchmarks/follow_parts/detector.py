"""A detector of people with delay, misses, noise, false and merged boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from follow_parts.rendering import CAMERA, Seen
from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import Box, bounding_box, box_corners, iou

INTERVAL, DELAY = 0.5, 0.3
_MISSED, _NOISE, _FALSE, _MERGED_ABOVE, _LEAST_VISIBLE = 0.1, 0.05, 0.02, 0.5, 0.4
# Least height of a box, pixels.
_LEAST_HEIGHT = 40.0


def detect(people: Sequence[Seen], generator: np.random.Generator) -> Detections:
    """What the detector finds in an image with people."""
    boxes = [
        box
        for one in people
        if one.shown >= _LEAST_VISIBLE
        if (box := one.box_in_image) and box[3] >= _LEAST_HEIGHT
    ]
    found: list[Box] = []
    for box in _merged(boxes):
        noise = generator.normal(0.0, _NOISE, 4)
        is_missed = generator.random() < _MISSED
        x, y, width, height = box
        if not is_missed:
            found.append(
                (
                    x + (noise[0] - noise[2] / 2.0) * width,
                    y + (0.5 * noise[1] - noise[3] / 2.0) * height,
                    width * (1.0 + noise[2]),
                    height * (1.0 + noise[3]),
                )
            )
    is_false, place = generator.random() < _FALSE, generator.uniform(0.0, 1.0, 3)
    if is_false:
        height = 120.0 + 200.0 * place[2]
        x, y = place[0] * (CAMERA.width - 0.4 * height), place[1] * (CAMERA.height - height)
        found.append((x, y, 0.4 * height, height))
    scores = generator.uniform(0.6, 0.95, len(found))
    return Detections(found, scores, ["person"] * len(found))


def _merged(boxes: Sequence[Box]) -> list[Box]:
    """Boxes that overlap much as one box around them."""
    kept: list[Box] = []
    for box in sorted(boxes, key=lambda box: -box[2] * box[3]):
        for index, one in enumerate(kept):
            if float(iou(np.array(box), np.array(one))) > _MERGED_ABOVE:
                kept[index] = bounding_box([*box_corners(box), *box_corners(one)])
                break
        else:
            kept.append(box)
    return kept
