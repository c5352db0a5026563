"""Detections: validation, duplicate removal and descriptors, and their ROS message.

1. `Detections` holds the result of a detector for one frame, with its shapes checked.
2. `usable` selects the finite boxes inside the image and removes duplicates (non-maximum
   suppression).
3. `describe_detections` adds the appearance descriptor of each.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import Box, bounding_box_of_rotated, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tracking.input_checks import check_seconds

# Maximum length of a label.
_MAX_LABEL_LENGTH = 100
# Maximum number of detections in a frame; those of the best scores count.
_MAX_COUNT = 200
DUPLICATE_ABOVE = 0.65
"""Two boxes with an intersection over union above this are detections of one object."""
# A box is clear of others below this intersection over union.
_CLEAR_BELOW = 0.1
# Minimum width and height of a box, pixels.
_MIN_SIDE = 2.0
# Excess of a score over 0 to 1 that rounding explains.
_ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class Detections:
    """Objects that a detector found in one frame; empty where it ran and found none.

    Unusable detections (a box that is not finite, without area or outside of the image, a score
    that is not 0 to 1, such as percent) are skipped later, not refused. Duplicates count as one.

    Args:
        boxes: (M, 4) x, y, width, height in pixels, as in `Tracker.start`.
        scores: (M,) 0 to 1; None for 1 each.
        labels: (M,) such as "person"; None for empty texts.
        age: Seconds since the detector's frame was taken, 0 for the current frame.

    Attributes:
        boxes: As given, as floats; read-only.
        scores: As given, or ones; read-only.
        labels: As given, or empty texts.
        age: As given.

    Raises:
        ValueError: The shapes do not match, or the age is negative or no number.

    Example:
        Two boxes of a detector that took 0.1 s:

        >>> from pf_tracker_ros import Detections
        >>> boxes = [(62, 31, 53, 70), (200, 40, 90, 60)]
        >>> found = Detections(boxes, [0.9, 0.7], ["person", "car"], age=0.1)
        >>> len(found), found.with_labels(["car"]).boxes.tolist()
        (2, [[200.0, 40.0, 90.0, 60.0]])
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: tuple[str, ...]
    age: float

    def __init__(
        self,
        boxes: ArrayLike,
        scores: ArrayLike | None = None,
        labels: Sequence[str] | None = None,
        age: float = 0.0,
    ) -> None:
        all_boxes = _floats(boxes, "boxes")
        if all_boxes.size == 0:
            all_boxes = all_boxes.reshape(0, 4)
        if all_boxes.ndim != 2 or all_boxes.shape[1] != 4:
            raise ValueError(
                f"boxes have the shape {all_boxes.shape}; expected (M, 4): x, y, width, height"
            )
        count = len(all_boxes)
        all_scores = np.ones(count) if scores is None else _floats(scores, "scores")
        if all_scores.shape != (count,):
            raise ValueError(
                f"scores have the shape {all_scores.shape}; expected ({count},), one per box"
            )
        is_list = isinstance(labels, Iterable) and not isinstance(labels, str)
        texts = tuple(labels) if labels is not None and is_list else ("",) * count
        if not (labels is None or is_list) or not all(isinstance(text, str) for text in texts):
            raise ValueError(
                f"labels are {labels!r}; expected {counted(count, 'text')}, one per box"
            )
        if len(texts) != count:
            raise ValueError(f"{counted(len(texts), 'label')}; expected {count}, one per box")
        all_boxes.setflags(write=False)
        all_scores.setflags(write=False)
        values = (all_boxes, all_scores, texts, check_seconds(age, "age"))
        for name, value in zip(("boxes", "scores", "labels", "age"), values, strict=True):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.boxes)

    def with_labels(self, labels: Collection[str]) -> Detections:
        """The detections with one of these labels; all for no labels."""
        if not labels:
            return self
        numbers = [number for number, label in enumerate(self.labels) if label in labels]
        texts = [self.labels[number] for number in numbers]
        return Detections(self.boxes[numbers], self.scores[numbers], texts, self.age)


class StampedDetections(NamedTuple):
    """Detections in the frame of a stamp, nanoseconds; 0 for the next frame."""

    detections: Detections
    stamp: int


class Detection(NamedTuple):
    """One detection, with its appearance.

    Attributes:
        box: (4,) in pixels, inside the image.
        score: 0 to 1.
        label: Or an empty text.
        is_clear: Whether no other detection overlaps it.
    """

    box: NDArray[np.float64]
    score: float
    label: str
    descriptor: Descriptor
    is_clear: bool = True


def usable(
    detections: Detections, size: tuple[int, int], score_above: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], list[str]]:
    """Select the detections that count in an image of (width, height), the best score first.

    Lower scores than `score_above` are left out without a reason.

    Returns:
        (K,) numbers of the detections that count, their (K, 4) boxes clipped to the image, and a
        sentence for each reason why others do not count.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        boxes, scores = detections.boxes, detections.scores
        ends = boxes[:, :2] + boxes[:, 2:]
        finite = np.isfinite(boxes).all(axis=1) & np.isfinite(scores) & np.isfinite(ends).all(1)
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        starts, ends = np.maximum(boxes[:, :2], 0.0), np.minimum(ends, size)
        in_range = (scores >= -_ROUNDING) & (scores <= 1.0 + _ROUNDING)
        inside = ((centers >= 0.0) & (centers <= size)).all(axis=1)
        has_area = (boxes[:, 2:] >= _MIN_SIDE).all(axis=1)
        has_area &= (ends - starts >= _MIN_SIDE).all(axis=1) | ~inside
    valid = finite & in_range
    reasons = [
        f"{count} of {counted(len(boxes), 'detection')} left out: {reason}"
        for count, reason in (
            (int((~finite).sum()), "a box or score is not finite"),
            (int((finite & ~in_range).sum()), "a score is not 0 to 1"),
            (int((valid & ~has_area).sum()), "a box is smaller than 2 px"),
            (int((valid & has_area & ~inside).sum()), "its center is outside of the image"),
        )
        if count
    ]
    numbers = np.flatnonzero(valid & has_area & inside & (scores >= score_above))
    numbers = numbers[np.argsort(-scores[numbers], kind="stable")]
    if len(numbers) > _MAX_COUNT:
        reasons.append(
            f"{len(numbers) - _MAX_COUNT} of {len(boxes)} detections left out: the {_MAX_COUNT} "
            "with the best scores count"
        )
        numbers = numbers[:_MAX_COUNT]
    clipped = np.hstack([starts, ends - starts])
    # Ranks for scores: OpenCV's order of equal scores is undefined.
    ranks = np.linspace(1.0, 0.5, len(numbers))
    kept = cv2.dnn.NMSBoxes(clipped[numbers].tolist(), ranks.tolist(), 0.0, DUPLICATE_ABOVE)
    numbers = numbers[np.asarray(kept, dtype=np.intp).ravel()]
    return numbers, clipped[numbers], reasons


def describe_detections(
    detections: Detections, frame: Frame, score_above: float, appearance: Appearance
) -> tuple[list[Detection], list[str]]:
    """The detections of a frame that count, with descriptors; and why others do not count."""
    numbers, boxes, reasons = usable(detections, frame.size, score_above)
    overlaps = pairwise_iou(boxes, boxes)
    np.fill_diagonal(overlaps, 0.0)
    clear = overlaps.max(axis=1, initial=0.0) < _CLEAR_BELOW
    described = [
        Detection(
            box,
            float(np.clip(detections.scores[number], 0.0, 1.0)),
            detections.labels[number][:_MAX_LABEL_LENGTH],
            descriptor,
            bool(is_clear),
        )
        for number, box, descriptor, is_clear in zip(
            numbers, boxes, appearance.extract(frame, boxes), clear, strict=True
        )
    ]
    return described, reasons


def _floats(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """A copy as floats.

    Raises:
        ValueError: The values are no numbers.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} are no array of numbers: {error}") from error
    if array.dtype.kind not in "iuf" and array.size > 0:
        raise ValueError(f"{name} are {values!r:.100}; expected numbers")
    return np.array(array, dtype=np.float64) if array.size else np.zeros(array.shape)


# Maximum size of a message, bytes: about a thousand detections.
_MAX_MESSAGE_SIZE = 500_000


def check_message_size(octets: bytes) -> None:
    """Refuse a serialized message that takes too long to deserialize.

    Raises:
        ValueError: It is longer than 500,000 bytes.
    """
    if len(octets) > _MAX_MESSAGE_SIZE:
        raise ValueError(
            f"the message has {len(octets)} bytes; allowed: up to {_MAX_MESSAGE_SIZE}, about a "
            "thousand detections; leave out those with low scores"
        )


def detections_from_message(message: Any) -> Detections:
    """The detections of a vision_msgs Detection2DArray.

    Label and score are those of the best hypothesis; without one they are empty and 1. A rotated
    box becomes its upright bounding box.
    """
    boxes, scores, labels = [], [], []
    for detection in message.detections:
        boxes.append(upright_box(detection.bbox))
        best = max(
            (one.hypothesis for one in detection.results), key=lambda one: one.score, default=None
        )
        scores.append(1.0 if best is None else best.score)
        labels.append("" if best is None else best.class_id)
    return Detections(boxes, scores, labels)


def upright_box(box: Any) -> Box:
    """The upright bounding box of a vision_msgs BoundingBox2D, which may be rotated."""
    center = box.center
    return bounding_box_of_rotated(
        (center.position.x, center.position.y), (box.size_x, box.size_y), center.theta
    )
