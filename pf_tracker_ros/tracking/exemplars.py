"""Exemplars: what the target looked like in frames in which it was surely seen.

A cue's template adapts in every frame, also to an occluder or a similar object. Exemplars are added
rarely and never change, so a single occlusion cannot overwrite them. Only a detection that is
learned starts them anew (`StateOperations.relearn`):

1. Describe the box by its oriented gradients (`oriented_gradients.py`) and by its color
   stripes (`appearances.color_stripes`).
2. Similarity to the target: the mean Bhattacharyya coefficient of the three most similar exemplars.
   The gradients have 0.7 of the weight, by logistic regression.
3. Add an exemplar every 0.5 s while the target is surely seen. The first one stays. Beyond eight,
   the older one of the two most similar others is removed, so that different views remain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.oriented_gradients import gradient_descriptors
from pf_tracker_ros.values import replace

_COLORS = ColorStripes()
_GRADIENT_WEIGHT = 0.7
_MAX_COUNT = 8
# Exemplars in the mean similarity.
_COMPARED = 3
# Seconds from one exemplar to the next.
_INTERVAL = 0.5
# Confidence from which on the target is surely seen.
_SURE_ABOVE = 0.9


@dataclass(frozen=True, eq=False)
class Exemplars:
    """The exemplars of one target; an immutable value.

    Attributes:
        descriptors: (K, D) of unit length, the first one of the first frame.
        age: Seconds since one was added.
    """

    descriptors: NDArray[np.float32]
    age: float = 0.0

    @classmethod
    def of(cls, frame: Frame, box: NDArray[np.float64]) -> Exemplars:
        """The exemplar of the (4,) box in a first frame, pixels."""
        return cls(describe(frame, box[None]))

    def similarities(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(K,) similarities of (K, 4) boxes, pixels, to the target, 0 (nothing in common) to 1."""
        coefficients = np.sort(describe(frame, boxes) @ self.descriptors.T)
        return coefficients[:, -_COMPARED:].mean(axis=1)

    def update(
        self, frame: Frame, box: NDArray[np.float64], interval: float, confidence: float
    ) -> Exemplars:
        """The exemplars one frame later, with a new one of a (4,) box, pixels, if it is time.

        The confidence is the probability that the box shows the target, 0 to 1; 0 adds nothing.
        """
        age = self.age + interval
        if age < _INTERVAL or confidence < _SURE_ABOVE:
            return replace(self, age=age)
        descriptors = np.vstack([self.descriptors, describe(frame, box[None])])
        if len(descriptors) > _MAX_COUNT:
            likeness = descriptors[1:] @ descriptors[1:].T
            np.fill_diagonal(likeness, -1.0)
            older, _ = divmod(int(np.argmax(likeness)), len(likeness))
            descriptors = np.delete(descriptors, 1 + older, axis=0)
        return Exemplars(descriptors)


def describe(frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """(K, D) descriptors, of unit length, of (K, 4) boxes with their centers in the image, pixels.

    Without any gradient they are shorter.
    """
    gradients = math.sqrt(_GRADIENT_WEIGHT) * gradient_descriptors(frame, boxes)
    colors = math.sqrt(1.0 - _GRADIENT_WEIGHT) * _COLORS.extract(frame, boxes)
    return np.concatenate([gradients, colors], axis=1)
