"""One-pass evaluation of trackers on sequences with ground truth.

`evaluate_sequence` evaluates any tracker with methods `start` and `update`:

    result = evaluate_sequence(read_sequence(folder), make_tracker, seeds=range(3))
    print(result.scores.success_auc)
"""

from pf_tracker_ros.evaluation.metrics import (
    center_errors,
    has_target,
    overlap,
    precision,
    success_auc,
    success_curve,
)
from pf_tracker_ros.evaluation.one_pass import (
    BoxEstimate,
    BoxTracker,
    TrackerFactory,
    evaluate_each,
    evaluate_sequence,
    evaluate_sequences,
)
from pf_tracker_ros.evaluation.results import (
    EvaluationError,
    Scores,
    SequenceFailure,
    SequenceResult,
    mean_scores,
)
from pf_tracker_ros.evaluation.sequences import find_sequences, read_sequences

__all__ = [
    "BoxEstimate",
    "BoxTracker",
    "EvaluationError",
    "Scores",
    "SequenceFailure",
    "SequenceResult",
    "TrackerFactory",
    "center_errors",
    "evaluate_each",
    "evaluate_sequence",
    "evaluate_sequences",
    "find_sequences",
    "has_target",
    "mean_scores",
    "overlap",
    "precision",
    "read_sequences",
    "success_auc",
    "success_curve",
]
