"""Checks the ground truth of a sequence before its evaluation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.plurals import counted


def usable_ground_truth(footage: Footage) -> NDArray[np.float64]:
    """The true boxes of a sequence, checked for evaluation.

    Returns:
        (frames, 4) x, y, width, height in pixels. The first has a target; in later frames it may
        be absent, see `metrics.has_target`.

    Raises:
        EvaluationError: No ground truth, fewer than 2 frames, not as many boxes as frames, or no
            target in the first frame.
    """
    if footage.ground_truth is None:
        raise EvaluationError(f"{footage.name}: no ground truth; expected a box for each frame")
    true_boxes = np.array(footage.ground_truth, dtype=np.float64)
    if true_boxes.ndim != 2 or true_boxes.shape[1] != 4 or len(true_boxes) < 2:
        raise EvaluationError(
            f"{footage.name}: ground truth of shape {true_boxes.shape}; "
            "allowed: x, y, width, height of at least 2 frames"
        )
    if not metrics.has_target(true_boxes[0]):
        raise EvaluationError(
            f"{footage.name}: the target is absent in the first frame, where tracking starts; "
            "allowed: finite numbers, width and height above 0"
        )
    if footage.frame_count is not None and footage.frame_count != len(true_boxes):
        raise count_mismatch(footage.name, counted(footage.frame_count, "frame"), len(true_boxes))
    return true_boxes


def count_mismatch(name: str, frames: str, boxes: int) -> EvaluationError:
    """The error for different numbers of frames and true boxes."""
    true_boxes = counted(boxes, "true box", "true boxes")
    return EvaluationError(f"{name}: {frames}, but {true_boxes}; expected a box for each frame")
