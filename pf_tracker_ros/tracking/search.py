"""Search around the prediction, for a target that moves as the motion model does not predict.

1. Lay a grid of box centers around the predicted box.
2. Let the cues respond to every box of the grid; cues that can search do so at little cost.
3. Draw a share of the particles from the likelihood on the grid, with weights times p / q.
4. Compare the responses beside the target with those at it: distractor ratios, second peak and
   distractor box.

Source of step 3: importance sampling, see `filter/proposals.py`.
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

# Distance of neighboring centers, box sizes.
_SPACING = 0.075
# Particles within this distance of the likeliest one, in box sizes, belong to its mode.
_MODE_RADIUS = 0.25
# Least distance of a distractor from the target along one axis, box sides.
_DISTRACTOR_DISTANCE = 0.6
# A grid point and its neighbors.
_NEIGHBORHOOD = np.ones((3, 3), np.uint8)


class Search:
    """A grid of boxes of the size of a (4,) predicted one around it, with centers in the image.

    Attributes:
        center_box: (4,) the predicted box, pixels.
        grid: The boxes.
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
        # Centers of the boxes along each axis.
        self._centers = np.minimum(np.maximum(self._cells.axes, 0.0), np.array(image_size)[:, None])
        left, top = self._centers - size[:, None] / 2
        self.grid = BoxGrid(left, top, size)
        self.boxes = self.grid.boxes

    def cover(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 4) boxes that cover the (N, 4) predicted ones and every box that can be drawn."""
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
        """Replace a share of the predicted particles by samples of the (M,) likelihood of `boxes`.

        Returns:
            The particles, weights times p / q, and the (N,) logarithms of their prior density.
        """
        proposed = propose_from_search(
            predicted.states[:, :2],
            centers,
            GridDensity(self._cells, log_likelihood),
            self._parameters.share,
            generator,
        )
        states = predicted.states.copy()
        states[:, :2] = proposed.centers
        particles = predicted.move(motion.constrain(states, self._image_size))
        log_prior = predicted.log_weights + proposed.log_prior
        return particles.reweight(proposed.log_ratio), log_prior

    def distractor_ratios(
        self, box: NDArray[np.float64], at_target: Responses, responses: Responses
    ) -> DistractorRatios:
        """Each searchable cue's largest response beside the target over that at the target.

        The (4,) box of the target has (1,) responses of each cue, and `boxes` (M,) responses.
        """
        beside = self._beside(box, 0.5)
        return measure_distractor_ratios(
            {name: float(response[0]) for name, response in at_target.items()},
            {name: response[beside] for name, response in responses.items()},
        )

    def second_peak(
        self, box: NDArray[np.float64], log_likelihood: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """(4,) likeliest of the M `boxes` that does not overlap the (4,) target; None if all do."""
        beside = self._beside(box, 1.0)
        if not beside.any():
            return None
        return self.boxes[np.argmax(np.where(beside, log_likelihood, -np.inf))]

    def distractor_box(
        self,
        box: NDArray[np.float64],
        at_target: Responses,
        responses: Responses,
        least_similarity: float,
    ) -> NDArray[np.float64] | None:
        """(4,) box beside the target that all cues together find most similar to it.

        The responses are those of `distractor_ratios`, of at least one cue. The similarity is the
        geometric mean of the cues' response ratios, 0 (nothing in common) to 1 (the same).

        Returns:
            None if no peak inside the grid is so similar. A slope towards the target or towards the
            border of the grid has its peak elsewhere.
        """
        cells = self._cells.count
        similarity = np.ones((cells, cells))
        for name, response in at_target.items():
            ratio = responses[name].reshape(cells, cells) / max(float(response[0]), 1e-3)
            similarity *= np.minimum(np.maximum(ratio, 0.0), 1.0)
        is_beside = self._beside(box, _DISTRACTOR_DISTANCE).reshape(cells, cells)
        is_peak = (similarity >= least_similarity ** len(at_target)) & is_beside
        is_peak[[0, -1]] = is_peak[:, [0, -1]] = False
        if is_peak.any():
            is_peak &= similarity >= cv2.dilate(similarity, _NEIGHBORHOOD)
        if not is_peak.any():
            return None
        return self.boxes[int(np.argmax(np.where(is_peak, similarity, -1.0)))]

    def _beside(self, box: NDArray[np.float64], distance: float) -> NDArray[np.bool_]:
        """(M,) whether `boxes` are further than a distance, in box sides, from a (4,) box."""
        middle = box[:2] + box[2:] / 2
        across, down = np.abs(self._centers - middle[:, None]) > distance * box[2:, None]
        return (down[:, None] | across).ravel()


def mode_mean(
    particles: ParticleSet, boxes: NDArray[np.float64], map_index: int
) -> NDArray[np.float64]:
    """(D,) mean of the mode around the maximum a posteriori particle, by (N, 4) boxes, pixels.

    The mean of several modes may lie between them, where no particle is likely.
    """
    centers = boxes[:, :2] + boxes[:, 2:] / 2
    radius = _MODE_RADIUS * math.sqrt(boxes[map_index, 2] * boxes[map_index, 3])
    is_near = np.square(centers - centers[map_index]).sum(axis=1) <= radius**2
    weights = particles.weights * is_near
    return weights @ particles.states / weights.sum()
