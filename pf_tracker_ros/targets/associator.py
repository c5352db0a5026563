"""Which detection is of which target."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pf_tracker_ros.targets.appearance import unlikeness
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.life import Life

# Standard deviations of a detection's center, in widths and in heights of its box.
CENTER_SPREAD = (0.15, 0.1)
# Of the logarithms of its sides.
_SIZE_SPREAD = np.array([0.25, 0.15])
# Squared distance, in units of its covariance, beyond which a detection is of another target. The
# tails are heavy: people crouch, and detectors cut them in two or join them.
_GATE = 60.0
_TAIL, _TAIL_WEIGHT = 3.0, 1.5
# Weight of a look that has nothing in common, of a size, and of another label.
_LOOK_WEIGHT, _SIZE_WEIGHT, _LABEL_WEIGHT = 3.0, 0.07, 1.0
_MOST_OF_SIZE = 16.0
# A detection that costs more than this is of none of the targets.
_MOST_COST = 5.0


class Associator:
    """Assigns detections to targets, all at once, at the least cost.

    The cost of a pair is what a detection of the target would be unlikely for: its distance under
    the covariance of the particles and of the detector, its size, its look and its label.
    """

    def assign(
        self,
        lives: Sequence[Life],
        predicted: NDArray[np.float64],
        seen: Sequence[Sighting],
    ) -> dict[int, int]:
        """Place of a target to the place of its detection; each at most once.

        Args:
            lives: N targets.
            predicted: (N, 4) boxes that they are expected in, pixels.
            seen: M detections.
        """
        if not lives or not seen:
            return {}
        boxes = np.array([one.box for one in seen])
        costs = np.array(
            [
                self._costs(life, box, seen, boxes)
                for life, box in zip(lives, predicted, strict=True)
            ]
        )
        rows, columns = linear_sum_assignment(np.minimum(costs, _MOST_COST))
        return {
            int(row): int(column)
            for row, column in zip(rows, columns, strict=True)
            if costs[row, column] < _MOST_COST
        }

    def _costs(
        self,
        life: Life,
        place: NDArray[np.float64],
        seen: Sequence[Sighting],
        boxes: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """(M,) of one target; infinite beyond the gate."""
        size = place[2:]
        of_detector = np.diag(np.square(CENTER_SPREAD * size))
        covariance = life.target.particles.covariance[:2, :2] + of_detector
        apart = boxes[:, :2] + boxes[:, 2:] / 2 - place[:2] - size / 2
        squared = np.einsum("ni,ij,nj->n", apart, np.linalg.inv(covariance), apart)
        spread = 0.5 * math.log(np.linalg.det(covariance) / np.linalg.det(of_detector))
        sizes = np.square(np.log(boxes[:, 2:] / size) / _SIZE_SPREAD).sum(axis=1)
        costs = _TAIL_WEIGHT * np.log1p(squared / _TAIL) + spread
        costs += _SIZE_WEIGHT * np.minimum(sizes, _MOST_OF_SIZE)
        costs[squared > _GATE] = np.inf
        label = life.label
        for number in np.flatnonzero(costs < _MOST_COST).tolist():
            one = seen[number]
            costs[number] += _LOOK_WEIGHT * unlikeness(life.look, one.look)
            costs[number] += _LABEL_WEIGHT * (one.label != label)
        return costs
