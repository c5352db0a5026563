"""Looking for the target around the prediction, wherever the motion model would not go.

The cues that many boxes cost next to nothing are asked about a grid of places. A share of the
particles is then drawn where they find the target likely, and what stands out beside the target
tells how far each cue is to be believed.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.fusion import DistractorRatios, Responses, measure_distractor_ratios
from pf_tracker_ros.filter import (
    CenterPrior,
    GridDensity,
    MotionModel,
    ParticleSet,
    ProposalParameters,
    SearchGrid,
    propose_from_search,
)

# From one place to the next in the square that is searched, box sizes.
_SPACING = 0.075
# Particles so near to the likeliest, in box sizes, belong to the same mode.
_MODE_REACH = 0.25
# What is so far from the target, in its own sides, along one axis at least, is something else.
_ELSEWHERE = 0.6
# A place of the grid and its neighbors.
_AROUND = np.ones((3, 3), np.uint8)


class Search:
    """A grid of boxes around the place where the target is expected.

    Args:
        center_box: (4,) box in the middle of the grid, pixels.
        parameters: Extent of the grid and share of the particles.
        image_size: (width, height); no center is looked for outside.

    Attributes:
        center_box: As given.
        grid: Boxes of the place's size.
        boxes: (M, 4) the same, pixels.
    """

    def __init__(
        self,
        center_box: NDArray[np.float64],
        parameters: ProposalParameters,
        image_size: tuple[int, int],
    ) -> None:
        size = center_box[2:]
        self._side = parameters.window * math.sqrt(size[0] * size[1])
        self.center_box = center_box
        cells = round(parameters.window / _SPACING)
        self._cells = SearchGrid(center_box[:2] + size / 2, self._side / cells, cells)
        self._parameters = parameters
        self._image_size = image_size
        # Of the boxes, along each axis.
        self._centers = np.minimum(np.maximum(self._cells.axes, 0.0), np.array(image_size)[:, None])
        left, top = self._centers - size[:, None] / 2
        self.grid = BoxGrid(left, top, size)
        self.boxes = self.grid.boxes

    def cover(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 4) boxes that cover all that can be looked at, given the (N, 4) predicted ones."""
        largest = np.maximum(boxes[:, 2:].max(axis=0), self.center_box[2:])
        spacing = self._cells.spacing
        ends = self._cells.axes[:, [0, -1]].T + [[-spacing], [spacing]]
        ends = np.minimum(np.maximum(ends, 0.0), self._image_size)
        covering = np.empty((len(boxes) + 2, 4))
        covering[:-2] = boxes
        covering[-2:, :2] = ends - largest / 2
        covering[-2:, 2:] = largest
        return covering

    def propose(
        self,
        predicted: ParticleSet,
        motion: MotionModel,
        centers: CenterPrior,
        log_likelihood: NDArray[np.float64],
        generator: np.random.Generator,
    ) -> tuple[ParticleSet, NDArray[np.float64]]:
        """Particles of which a share is where the target is likely.

        Args:
            predicted: Particles drawn from the transition prior.
            motion: Drew them.
            centers: Their centers' distribution, as the motion model tells it.
            log_likelihood: (M,) of `boxes`.
            generator: Source of randomness.

        Returns:
            The particles, their weights corrected for where they were drawn, and the (N,)
            logarithms of their prior density.
        """
        searched = propose_from_search(
            predicted.states[:, :2],
            centers,
            GridDensity(self._cells, log_likelihood),
            self._parameters.share,
            generator,
        )
        states = predicted.states.copy()
        states[:, :2] = searched.centers
        particles = predicted.move(motion.constrain(states, self._image_size))
        log_prior = predicted.log_weights + searched.log_prior
        return particles.reweight(searched.log_ratio), log_prior

    def covariance(
        self,
        within_mode: NDArray[np.float64],
        confidence: float,
        walk: float | None,
    ) -> NDArray[np.float64]:
        """(2, 2) covariance of the target's center about the box, px^2.

        With the probability that the confidence gives, the target is in the mode that the particles
        are in; if not, it may be anywhere in what was searched. While it is hidden, that is all
        that is known, and it walks on.

        Args:
            within_mode: (2, 2) covariance of the particles' centers about the box, px^2.
            confidence: In this frame, 0 to 1.
            walk: Standard deviation of the target's walk since it was last seen, box sizes; None
                while it is tracked.
        """
        variance = self._side**2 / 12.0
        if walk is not None:
            size = math.sqrt(self.center_box[2] * self.center_box[3])
            return (variance + (walk * size) ** 2) * np.eye(2)
        return confidence * within_mode + (1.0 - confidence) * variance * np.eye(2)

    def distractor_ratios(
        self,
        box: NDArray[np.float64],
        own: Responses,
        strengths: Responses,
    ) -> DistractorRatios:
        """Each searchable cue's distraction around a (4,) box.

        Args:
            box: Of the target.
            own: Name of a cue to its (1,) strength there.
            strengths: Name of a cue to its (M,) strengths at `boxes`.
        """
        beside = self._beside(box, 0.5)
        return measure_distractor_ratios(
            {name: float(strength[0]) for name, strength in own.items()},
            {name: strength[beside] for name, strength in strengths.items()},
        )

    def second_peak(
        self, box: NDArray[np.float64], log_likelihood: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """(4,) likeliest of `boxes` that does not overlap a (4,) box; None where all do.

        Args:
            box: Of the target.
            log_likelihood: (M,) of `boxes`.
        """
        beside = self._beside(box, 1.0)
        if not beside.any():
            return None
        return self.boxes[np.argmax(np.where(beside, log_likelihood, -np.inf))]

    def distractor_box(
        self, box: NDArray[np.float64], own: Responses, strengths: Responses, least: float
    ) -> NDArray[np.float64] | None:
        """What looks most like the target beside it, to all cues together, as a (4,) box.

        Args:
            box: (4,) of the target.
            own: Name of a cue to its (1,) strength there; at least one.
            strengths: Name of a cue to its (M,) strengths at `boxes`.
            least: How much it must look like the target, 0 (nothing in common) to 1 (the same).

        Returns:
            None where nothing does: what rises towards the target, or towards the end of what was
            searched, has its peak elsewhere.
        """
        cells = self._cells.count
        alike = np.ones((cells, cells))
        for name, strength in own.items():
            share = strengths[name].reshape(cells, cells) / max(float(strength[0]), 1e-3)
            alike *= np.minimum(np.maximum(share, 0.0), 1.0)
        is_peak = (alike >= least ** len(own)) & self._beside(box, _ELSEWHERE).reshape(cells, cells)
        is_peak[[0, -1]] = is_peak[:, [0, -1]] = False
        if is_peak.any():
            is_peak &= alike >= cv2.dilate(alike, _AROUND)
        if not is_peak.any():
            return None
        best: NDArray[np.float64] = self.boxes[int(np.argmax(np.where(is_peak, alike, -1.0)))]
        return best

    def _beside(self, box: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
        """(M,) whether `boxes` are further from a (4,) one than so many of its sides."""
        middle = box[:2] + box[2:] / 2
        across, down = np.abs(self._centers - middle[:, None]) > reach * box[2:, None]
        return (down[:, None] | across).ravel()


def covariance_about(particles: ParticleSet, center: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 2) weighted covariance, px^2, of the particles' centers about a (2,) center."""
    offsets = particles.states[:, :2] - center
    return (offsets * particles.weights[:, None]).T @ offsets


def mode_mean(particles: ParticleSet, boxes: NDArray[np.float64], best: int) -> NDArray[np.float64]:
    """(D,) mean of the particles, given also as (N, 4) boxes, of the mode that one of them is in.

    The mean of several modes may be where nothing speaks for the target.
    """
    centers = boxes[:, :2] + boxes[:, 2:] / 2
    reach = _MODE_REACH * math.sqrt(boxes[best, 2] * boxes[best, 3])
    near = np.square(centers - centers[best]).sum(axis=1) <= reach**2
    weights = particles.weights * near
    return weights @ particles.states / weights.sum()
