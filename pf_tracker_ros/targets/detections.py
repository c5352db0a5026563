"""What a detector says of a frame, and how its messages say it."""

from __future__ import annotations

import math
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

# Characters of a label.
_LONGEST_LABEL = 100
# No camera shows more that could be told apart; the best scores are kept.
_MOST = 200
# Two boxes that overlap by more than this (intersection over union) are one object, seen twice.
DUPLICATE_ABOVE = 0.65
# A box that overlaps another by less than this shows its own object alone.
_CLEAR_BELOW = 0.1
# Narrower and lower boxes hold too few pixels.
_SMALLEST_SIDE = 2.0


@dataclass(frozen=True, eq=False)
class Detections:
    """What a detector found in one frame; an empty one says that it ran and found nothing.

    Boxes that are no use (not finite, without area, outside of the image) are left out where they
    are used, since a detector that now and then gives one is worth hearing; doubled ones count as
    one.

    Args:
        boxes: (M, 4) x, y, width, height in pixels, as in `Tracker.start`.
        scores: (M,) of the detector, 0 to 1; None where it gives none, which counts as 1.
        labels: (M,) what each is, such as "person"; None where it does not tell.
        age: Seconds since the frame was taken that the detector saw, 0 for the one at hand.

    Attributes:
        boxes: As given, as floats; read-only.
        scores: As given, or ones; read-only.
        labels: As given, or empty texts.
        age: As given.

    Raises:
        ValueError: The shapes do not fit each other, or the age is no time.
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
        four = _floats(boxes, "boxes")
        if four.size == 0:
            four = four.reshape(0, 4)
        if four.ndim != 2 or four.shape[1] != 4:
            raise ValueError(
                f"boxes have the shape {four.shape}; expected (M, 4), x, y, width and height each"
            )
        count = len(four)
        each = np.ones(count) if scores is None else _floats(scores, "scores")
        if each.shape != (count,):
            raise ValueError(f"scores have the shape {each.shape}; expected ({count},), one a box")
        is_list = isinstance(labels, Iterable) and not isinstance(labels, str)
        texts = tuple(labels) if labels is not None and is_list else ("",) * count
        if not (labels is None or is_list) or not all(isinstance(text, str) for text in texts):
            raise ValueError(f"labels are {labels!r}; expected {counted(count, 'text')}, one a box")
        if len(texts) != count:
            raise ValueError(f"given {counted(len(texts), 'label')}; expected {count}, one a box")
        if not _is_time(age):
            raise ValueError(f"age is {age!r}; allowed: a finite number of seconds from 0 up")
        four.setflags(write=False)
        each.setflags(write=False)
        for name, value in zip(
            ("boxes", "scores", "labels", "age"), (four, each, texts, float(age)), strict=True
        ):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.boxes)

    def with_labels(self, labels: Collection[str]) -> Detections:
        """Those with one of some labels; all where there are none."""
        if not labels:
            return self
        places = [place for place, label in enumerate(self.labels) if label in labels]
        texts = [self.labels[place] for place in places]
        return Detections(self.boxes[places], self.scores[places], texts, self.age)


def _is_time(age: object) -> bool:
    if isinstance(age, bool) or not isinstance(age, int | float | np.integer | np.floating):
        return False
    try:
        return 0.0 <= float(age) < math.inf
    except OverflowError:
        return False


class Detection(NamedTuple):
    """One object that a detector found.

    Attributes:
        box: (4,) in pixels, inside the image.
        score: 0 to 1.
        label: What it is, or an empty text.
        descriptor: Of what is in the box.
        is_clear: Whether none of the others overlaps it.
    """

    box: NDArray[np.float64]
    score: float
    label: str
    descriptor: Descriptor
    is_clear: bool = True


def usable(
    detections: Detections, size: tuple[int, int], score_above: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], list[str]]:
    """Which detections count, the best score first.

    Args:
        detections: Of any kind.
        size: (width, height) of the image.
        score_above: Those of a lower score are left out, which needs no reason.

    Returns:
        The (K,) numbers of those that count, their (K, 4) boxes cut to the image, and a sentence
        for each reason why others do not.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        boxes, scores = detections.boxes, detections.scores
        ends = boxes[:, :2] + boxes[:, 2:]
        finite = np.isfinite(boxes).all(axis=1) & np.isfinite(scores) & np.isfinite(ends).all(1)
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        starts, ends = np.maximum(boxes[:, :2], 0.0), np.minimum(ends, size)
        inside = ((centers >= 0.0) & (centers <= size)).all(axis=1)
        has_area = (boxes[:, 2:] >= _SMALLEST_SIDE).all(axis=1)
        has_area &= (ends - starts >= _SMALLEST_SIDE).all(axis=1) | ~inside
    reasons = [
        f"{count} of {counted(len(boxes), 'detection')} left out: {reason}"
        for count, reason in (
            (int((~finite).sum()), "a box or score is not finite"),
            (int((finite & ~has_area).sum()), "a box is smaller than 2 px"),
            (int((finite & has_area & ~inside).sum()), "its center is outside of the image"),
        )
        if count
    ]
    numbers = np.flatnonzero(finite & has_area & inside & (scores >= score_above))
    numbers = numbers[np.argsort(-scores[numbers], kind="stable")]
    if len(numbers) > _MOST:
        reasons.append(
            f"{len(numbers) - _MOST} of {len(boxes)} detections left out: the {_MOST} with the "
            "best scores count"
        )
        numbers = numbers[:_MOST]
    cut = np.hstack([starts, ends - starts])
    # Scores again by rank: equal ones would be sorted in an order of OpenCV's own.
    ranks = np.linspace(1.0, 0.5, len(numbers))
    kept = cv2.dnn.NMSBoxes(cut[numbers].tolist(), ranks.tolist(), 0.0, DUPLICATE_ABOVE)
    numbers = numbers[np.asarray(kept, dtype=np.intp).ravel()]
    return numbers, cut[numbers], reasons


def describe_detections(
    detections: Detections, frame: Frame, score_above: float, appearance: Appearance
) -> tuple[list[Detection], list[str]]:
    """What counts of the detections of a frame, all described at once; and why others do not."""
    numbers, boxes, reasons = usable(detections, frame.size, score_above)
    shared = pairwise_iou(boxes, boxes)
    np.fill_diagonal(shared, 0.0)
    clear = shared.max(axis=1, initial=0.0) < _CLEAR_BELOW
    found = [
        Detection(
            box,
            float(np.clip(detections.scores[number], 0.0, 1.0)),
            detections.labels[number][:_LONGEST_LABEL],
            descriptor,
            bool(is_clear),
        )
        for number, box, descriptor, is_clear in zip(
            numbers, boxes, appearance.extract(frame, boxes), clear, strict=True
        )
    ]
    return found, reasons


def _floats(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """A copy of numbers as floats.

    Raises:
        ValueError: They are none.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} are no array of numbers: {error}") from error
    if array.dtype.kind not in "iuf" and array.size > 0:
        raise ValueError(f"{name} are {values!r:.100}; expected numbers")
    return np.array(array, dtype=np.float64) if array.size else np.zeros(array.shape)


# Bytes of a message: a thousand detections, each of which becomes objects of Python.
_LARGEST = 500_000


def check_message_size(octets: bytes) -> None:
    """Refuse a serialized message that would take too long to read.

    Raises:
        ValueError: It is longer than about a thousand detections.
    """
    if len(octets) > _LARGEST:
        raise ValueError(
            f"the message has {len(octets)} bytes; allowed: up to {_LARGEST}, about a "
            "thousand detections; let the detector leave out those with low scores"
        )


def detections_from_message(message: Any) -> Detections:
    """The detections of a vision_msgs Detection2DArray.

    The label and the score are those of the hypothesis with the best score; without one there is no
    label, and the score is 1. A box that is turned counts as its upright outline.
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
    """The box around a vision_msgs BoundingBox2D, which may be turned."""
    center = box.center
    return bounding_box_of_rotated(
        (center.position.x, center.position.y), (box.size_x, box.size_y), center.theta
    )
