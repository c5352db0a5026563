r"""Fit the covariance of a box and measure it on footage that it was not fitted on.

    python benchmarks/box_covariance.py SEQUENCE_DIR... --seeds 3

Frames count in which the state is tracking and the box overlaps the true one by at least 0.1.

1. Track each sequence and keep the features of these frames and the errors of their boxes.
2. Leave out one sequence in turn, fit the coefficients on the others, and compare its errors with
   the fitted covariance.
3. Fit the coefficients on all: `COEFFICIENTS` of `pf_tracker_ros/tracking/box_covariance.py`.

A consistent covariance has a normalized error squared (NEES), over its degrees of freedom, of 1,
and its regions of 50, 90 and 99 % contain the truth in that share of the frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import arguments as options_of
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2
from tables import Table
from tracking_runs import estimates_of, followed, timed_images

from pf_tracker_ros.evaluation import EvaluationError, has_target, overlap, read_sequences
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.tracking.box_covariance import (
    COEFFICIENTS,
    SIZE_CORRELATION,
    box_features,
)

ON_TARGET = 0.1
SHARES = (0.5, 0.9, 0.99)
# Errors beyond are those of a few frames; they would set the scale of all.
_LARGEST_ERROR = 1.0
# The errors on footage that is not in the fit are larger; factor of their variance.
_UNSEEN = 1.25
# Keeps slopes of features without an effect near 0.
_SHRINKAGE = 1e-3


class Errors(NamedTuple):
    """Tracked frames of a sequence, all seeds."""

    features: NDArray[np.float64]  # (F, 4) from `box_features`
    # (F, 4) of the center, in box widths and heights, and of log width and log height
    errors: NDArray[np.float64]
    edges: NDArray[np.float64]  # (F,) error of the lower edge, box heights


def measure(footage: Footage, seeds: int) -> Errors:
    """Track a sequence with each seed."""
    truth = np.asarray(footage.ground_truth, dtype=float)
    features, errors, edges = [], [], []
    for seed in range(seeds):
        estimates = estimates_of("default", seed, timed_images(footage), truth[0])
        for estimate, true in zip(estimates, truth[1:], strict=True):
            box = np.array(estimate.box)
            is_on = has_target(true[None])[0] and overlap(box[None], true[None])[0] >= ON_TARGET
            if is_on and estimate.state == "tracking":
                features.append(box_features(box, estimate.confidence))
                offset = true[:2] + true[2:] / 2 - box[:2] - box[2:] / 2
                errors.append([*(offset / box[2:]), *np.log(true[2:] / box[2:])])
                edges.append((true[1] + true[3] - box[1] - box[3]) / box[3])
    return Errors(np.reshape(features, (-1, 4)), np.reshape(errors, (-1, 4)), np.array(edges))


def fit(measured: Sequence[Errors]) -> NDArray[np.float64]:
    """(4, 4) coefficients of maximum likelihood, wider by what unseen footage asks for.

    A sequence counts with the root of its number of frames.
    """
    features = np.concatenate([one.features for one in measured])
    errors = np.concatenate([one.errors for one in measured])
    counts = [len(one.edges) for one in measured]
    weights = np.concatenate([np.full(count, count**-0.5) for count in counts if count])
    weights /= weights.sum()

    def column(errors: NDArray[np.float64]) -> NDArray[np.float64]:
        squared = np.square(np.clip(errors, -_LARGEST_ERROR, _LARGEST_ERROR))

        def loss(slopes: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            log_std = features @ slopes
            scaled = squared * np.exp(-2.0 * log_std)
            shrunk = _SHRINKAGE * slopes * (np.arange(len(slopes)) > 0)
            value = weights @ (log_std + scaled / 2) + shrunk @ slopes
            return value, (weights * (1.0 - scaled)) @ features + 2.0 * shrunk

        start = np.zeros(features.shape[1])
        start[0] = np.log(weights @ squared) / 2
        return minimize(loss, start, jac=True, method="L-BFGS-B").x

    coefficients = np.array([column(one) for one in errors.T])
    coefficients[:, 0] += np.log(_UNSEEN) / 2
    return coefficients


def squared_errors(
    measured: Errors, coefficients: NDArray[np.float64]
) -> dict[str, tuple[NDArray[np.float64], int]]:
    """Name to normalized squared errors, (F,), and their degrees of freedom."""
    std = np.exp(measured.features @ coefficients.T)
    x, y, width, height = (measured.errors / std).T
    correlated = width**2 - 2 * SIZE_CORRELATION * width * height + height**2
    edge_variance = std[:, 1] ** 2 + std[:, 3] ** 2 / 4
    return {
        "center": (x**2 + y**2, 2),
        "size": (correlated / (1 - SIZE_CORRELATION**2), 2),
        "lower edge": (measured.edges**2 / edge_variance, 1),
    }


def summary(title: str, measured: Sequence[Errors], fitted: Sequence[NDArray[np.float64]]) -> Table:
    """NEES over the degrees of freedom and shares inside, each sequence by its coefficients."""
    parts = [squared_errors(one, by) for one, by in zip(measured, fitted, strict=True)]
    rows = []
    for name, (_, degrees) in parts[0].items():
        squared = np.concatenate([part[name][0] for part in parts])
        inside = (f"{(squared < chi2.ppf(share, degrees)).mean():.3f}" for share in SHARES)
        rows.append([name, f"{squared.mean() / degrees:.2f}", *inside])
    return Table(title, ("error", "NEES", *(f"inside {share:.0%}" for share in SHARES)), rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the tables and the coefficients."""
    parser = options_of.sequence_parser(__doc__)
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        sequences = read_sequences(options.sequences)
        if len(sequences) < 2:
            raise EvaluationError("one sequence; allowed: at least two, to leave one out")
        measured = [measure(footage, options.seeds) for footage in followed(sequences)]
    fitted = [fit([*measured[:number], *measured[number + 1 :]]) for number in range(len(measured))]
    summary("All sequences, each fitted on the others", measured, fitted).show()
    summary("All sequences, the package's", measured, [COEFFICIENTS] * len(sequences)).show()
    print("\nfitted on all:")
    print(np.array2string(fit(measured), precision=3, suppress_small=True, separator=", "))


if __name__ == "__main__":
    main()
