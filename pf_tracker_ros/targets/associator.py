"""Which detection is of which target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.targets.assignment import assign
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.life import Life

# Standard deviations of a detection's center, in widths and in heights of its box.
CENTER_SPREAD = np.array([0.15, 0.1])
# Of the logarithms of its sides.
_SIZE_SPREAD = np.array([0.25, 0.15])
# Degrees of freedom of a distance: the tails are heavy, since people crouch, and detectors cut them
# in two or join them.
_TAIL = 3.0
# Squared distance, in units of its variance, beyond which a detection is of another target, however
# alike they look.
_GATE = 60.0
# Weight of a size, and the most that it counts.
_SIZE_WEIGHT, _MOST_OF_SIZE = 0.3, 9.0
# Weight of the appearance, in units of how much that of the target usually varies, and up to how
# many of these it rather speaks for the target.
_APPEARANCE_WEIGHT, _USUALLY = 2.0, 2.4
# Weight of another label.
_LABEL_WEIGHT = 1.0
# A detection that costs more than this is of none of the targets.
_MOST_COST = 5.5


class Associator:
    """Assigns detections to targets, all at once, at the least cost.

    The cost of a pair is what a detection of the target would be unlikely for: its distance under
    the covariance of its course and of the detector, its size, its appearance and its label. The
    appearance counts as much as the target's own views are alike, so that it tells more in one
    footage than in another.

    Args:
        appearance: Compares descriptors.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def assign(
        self,
        lives: Sequence[Life],
        seen: Sequence[Sighting],
    ) -> dict[int, int]:
        """Place of a target to the place of its detection; each at most once.

        Args:
            lives: N targets, their courses in this frame.
            seen: M detections.
        """
        if not lives or not seen:
            return {}
        # Only here: without detections no SciPy is needed.

        boxes = np.array([one.box for one in seen])
        descriptors = np.array([one.descriptor for one in seen])
        costs = np.array([self._costs(life, seen, boxes, descriptors) for life in lives])
        return assign(costs, _MOST_COST)

    def _costs(
        self,
        life: Life,
        seen: Sequence[Sighting],
        boxes: NDArray[np.float64],
        descriptors: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """(M,) of one target; infinite beyond the gate."""
        size, course = np.exp(life.log_size), life.course
        of_detector = np.square(CENTER_SPREAD * size)
        variance = course.spread + of_detector
        apart = boxes[:, :2] + boxes[:, 2:] / 2 - course.center
        squared = (np.square(apart) / variance).sum(axis=1)
        costs = (_TAIL + 2.0) / 2.0 * np.log1p(squared / _TAIL)
        costs += 0.5 * np.log(variance / of_detector).sum()
        sizes = np.square(np.log(boxes[:, 2:] / size) / _SIZE_SPREAD).sum(axis=1)
        costs += _SIZE_WEIGHT * np.minimum(sizes, _MOST_OF_SIZE)
        label = life.label
        costs += _LABEL_WEIGHT * np.array([one.label != label for one in seen])
        differs = self._appearance.distance(life.descriptor, descriptors)
        costs += _APPEARANCE_WEIGHT * (differs / life.varies - _USUALLY)
        costs[squared > _GATE] = np.inf
        return costs
