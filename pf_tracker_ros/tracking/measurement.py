"""Measurement of a frame: the weights of the predicted particles and the box that they estimate.

`Measurer` is the filter of the papers:

1. Weigh each predicted particle by the likelihood of its box, the fused likelihood of the cues.
   Li et al. 2007, equation (8); Zhang et al. 2015, equation (10).
2. Estimate the box as the weighted mean. Zhang et al. 2015, equation (5).

`SearchingMeasurer` also finds a target that the motion model does not predict:

1. Compute the cues' responses on a grid around the predicted box, and the fused likelihood there.
2. Draw a share of the particles from this likelihood, with weights times p / q (`Search`).
3. Weigh, with more weight on the cues that respond to the target more than to its surroundings.
4. Estimate the mean of the mode around the maximum a posteriori particle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis, grown
from pf_tracker_ros.cues import CueFusion, Match
from pf_tracker_ros.cues.fusion import (
    CueWeights,
    DistractorRatios,
    Templates,
    smooth_distractor_ratios,
)
from pf_tracker_ros.filter import ParticleSet, ProposalParameters, SearchableMotion
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.tracking.assessment import AssessedBox, Assessment
from pf_tracker_ros.tracking.box_covariance import (
    box_covariance,
    box_features,
    particle_covariance,
)
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.prediction import Prediction
from pf_tracker_ros.tracking.search import Search, mode_mean

# Computes log likelihoods of boxes from a source other than the pixels.
ExternalLikelihood = Callable[[BoxesByAxis], NDArray[np.float64]]
# Similarity to the target, 0 to 1, of a distractor: the geometric mean over the cues.
_DISTRACTOR_ABOVE = 0.5
# Share of the growth that the cues tell by which the particles grow in a frame.
_GROWTH_GAIN = 0.25


class FramePrediction(NamedTuple):
    """A target predicted into a frame whose pixels have not been read yet.

    The state is that after the last frame. The (N, 4) boxes, pixels, are those of the predicted
    particles; the cues read the region. There is a search if a cue can search.
    """

    filter_state: FilterState
    frame: Frame
    interval: float
    prediction: Prediction
    generator: np.random.Generator
    boxes: NDArray[np.float64]
    region: Region
    search: Search | None = None


class Measurement(NamedTuple):
    """The weighted particles of a frame, their estimate, and the observation there.

    Attributes:
        frame_prediction: The target before the pixels of the frame were read.
        particles: The weighted particles, some of them drawn from the search if there is one.
        boxes: (N, 4) of the particles, pixels.
        box: (4,) estimate, pixels.
        seen: Each cue's observation of the box.
        match: Match of the observation with the templates.
        distractor_ratios: Smoothed ratio of each cue; see `cues.fusion.DistractorRatios`.
        second_peak: (4,) likeliest box beside the estimate, pixels; None without a search.
        distractor_box: (4,) box of the distractor in this frame, pixels; None if there is none, or
            no search.
    """

    frame_prediction: FramePrediction
    particles: ParticleSet
    boxes: NDArray[np.float64]
    box: NDArray[np.float64]
    cue_weights: CueWeights
    seen: Templates
    match: Match
    distractor_ratios: DistractorRatios
    second_peak: NDArray[np.float64] | None = None
    distractor_box: NDArray[np.float64] | None = None

    @property
    def state(self) -> FilterState:
        """State after the last frame."""
        return self.frame_prediction.filter_state

    @property
    def frame(self) -> Frame:
        """The frame."""
        return self.frame_prediction.frame

    @property
    def assessed(self) -> AssessedBox:
        """The estimate as a box that may be the target."""
        return AssessedBox(
            self.frame,
            self.box,
            self.seen,
            self.match,
            lambda: self.particle_std,
            self.second_peak,
        )

    @property
    def particle_std(self) -> float:
        """Weighted standard deviation of the particles' centers, box sizes."""
        centers = self.boxes[:, :2] + self.boxes[:, 2:] / 2
        offsets = centers - self.particles.weights @ centers
        variance = self.particles.weights @ np.square(offsets).sum(axis=1)
        return math.sqrt(variance / (self.box[2] * self.box[3]))


class Measurer:
    """Weighs every particle at its predicted box; the estimate is their mean."""

    def __init__(self, fusion: CueFusion, working_size: int) -> None:
        self._fusion = fusion
        self._working_size = working_size

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> tuple[Templates, DistractorRatios]:
        """Templates of a (4,) box, and the distractor ratios around it."""
        return self.templates(frame, box), {}

    def templates(self, frame: Frame, box: NDArray[np.float64]) -> Templates:
        """Templates of a (4,) box."""
        return self._fusion.learn(self._region(frame, box[None], box), box)

    def predict_frame(
        self,
        state: FilterState,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        generator: np.random.Generator,
        *,
        estimates_size: bool = True,
    ) -> FramePrediction:
        """Boxes of the predicted particles, and the region of the frame that covers them."""
        boxes = state.motion.boxes(prediction.particles.states)
        last_box = np.asarray(state.estimate.box)
        region = self._region(frame, boxes, last_box, estimates_size=estimates_size)
        return FramePrediction(state, frame, interval, prediction, generator, boxes, region)

    def log_growth(self, frame_prediction: FramePrediction, box: NDArray[np.float64]) -> float:
        """See `SearchableCue.log_growth`, of a (4,) box in this frame."""
        return self._fusion.log_growth(
            frame_prediction.region, box, frame_prediction.filter_state.templates
        )

    def measure(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
    ) -> Measurement:
        """The weighted particles, the box of their mean, and what the cues observe there.

        Each weight is multiplied by the likelihood of the particle's box.

        Source: Li et al. 2007, section 1 and equation (8); Zhang et al. 2015, equations (5), (10).
        """
        boxes, cue_weights = frame_prediction.boxes, self._fusion.cue_weights
        likelihood = self._log_likelihood(frame_prediction, boxes, cue_weights, external_likelihood)
        particles = frame_prediction.prediction.particles.reweight(likelihood)
        box = frame_prediction.filter_state.motion.boxes(particles.mean[None])[0]
        seen, match = self._observe(frame_prediction, box)
        return Measurement(frame_prediction, particles, boxes, box, cue_weights, seen, match, {})

    def _log_likelihood(
        self,
        frame_prediction: FramePrediction,
        boxes: NDArray[np.float64],
        cue_weights: CueWeights,
        external_likelihood: ExternalLikelihood | None,
    ) -> NDArray[np.float64]:
        """(N,) of (N, 4) boxes: that of the cues times the external one."""
        templates = frame_prediction.filter_state.templates
        likelihood = self._fusion.log_likelihood(
            frame_prediction.region, boxes, templates, cue_weights
        )
        if external_likelihood:
            likelihood = likelihood + external_likelihood(BoxesByAxis(*boxes.T))
        return likelihood

    def _observe(
        self, frame_prediction: FramePrediction, box: NDArray[np.float64]
    ) -> tuple[Templates, Match]:
        """What the cues observe in a (4,) box, and its match with the templates."""
        seen = self._fusion.observe(frame_prediction.region, box)
        return seen, self._fusion.match(seen, frame_prediction.filter_state.templates)

    def covariance(
        self, measurement: Measurement, assessment: Assessment, time_since_seen: float
    ) -> NDArray[np.float64]:
        """(4, 4) covariance of center x, center y, width and height of the box, px^2.

        The time is in seconds, at most `track.lost_after`.
        """
        return particle_covariance(assessment.particles, assessment.boxes)

    def log_likelihoods(
        self, state: FilterState, frame: Frame, boxes: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Name of each cue to its (N,) log likelihoods of (N, 4) boxes of the target's size."""
        center_box = np.asarray(state.estimate.box)
        region = self._region(frame, boxes, center_box, center_box)
        return self._fusion.log_likelihoods(region, boxes, state.templates)

    def _region(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        center_box: NDArray[np.float64] | None = None,
        *,
        estimates_size: bool = True,
    ) -> Region:
        """Region of (N, 4) boxes, reduced for the size of a (4,) box."""
        if center_box is None and self._fusion.uses_center_box_size:
            center_box = boxes.mean(axis=0)
        target_size = math.sqrt(target_box[2] * target_box[3])
        reduction = math.ceil(target_size / self._working_size)
        return Region(
            frame,
            boxes,
            reduction,
            self._fusion.context_margin,
            center_box=center_box,
            estimates_size=estimates_size,
        )


class SearchingMeasurer(Measurer):
    """Searches around the prediction and draws a share of the particles where the target is likely.

    The estimate is the mean of one mode. The cue weights adapt to the distractor ratios.
    """

    def __init__(
        self,
        fusion: CueFusion,
        working_size: int,
        parameters: ProposalParameters,
        adaptation: float,
    ) -> None:
        super().__init__(fusion, working_size)
        self._parameters = parameters
        self._adaptation = adaptation

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> tuple[Templates, DistractorRatios]:
        """See `Measurer.learn`."""
        search, region = self.search_window(frame, box)
        templates = self._fusion.learn(region, box)
        responses = self._fusion.responses_on_grid(region, search.grid, templates)
        at_target = self._fusion.responses(region, box[None], templates)
        return templates, search.distractor_ratios(box, at_target, responses)

    def search_window(self, frame: Frame, center_box: NDArray[np.float64]) -> tuple[Search, Region]:
        """A search around a (4,) box, and the region that it reads."""
        search = Search(center_box, self._parameters, frame.size)
        boxes = search.cover(center_box[None])
        return search, self._region(frame, boxes, center_box, center_box, estimates_size=False)

    def predict_frame(
        self,
        state: FilterState,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        generator: np.random.Generator,
        *,
        estimates_size: bool = True,
    ) -> FramePrediction:
        """See `Measurer.predict_frame`; the region covers the search grid, too."""
        if not self._fusion.searches(state.templates):
            # Cues that were just selected have no template in this frame.
            return super().predict_frame(
                state, frame, interval, prediction, generator, estimates_size=estimates_size
            )
        prediction = _grown(state, prediction, frame.size)
        boxes = state.motion.boxes(prediction.particles.states)
        search = Search(prediction.particles.weights @ boxes, self._parameters, frame.size)
        region = self._region(
            frame,
            search.cover(boxes),
            np.asarray(state.estimate.box),
            search.center_box,
            estimates_size=estimates_size,
        )
        return FramePrediction(state, frame, interval, prediction, generator, boxes, region, search)

    def measure(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
    ) -> Measurement:
        """See `Measurer.measure`; a share of the particles is drawn from the search.

        The mean is that of the maximum a posteriori mode.
        """
        state, search = frame_prediction.filter_state, frame_prediction.search
        if search is None:
            return super().measure(frame_prediction, external_likelihood)
        region, prediction = frame_prediction.region, frame_prediction.prediction
        motion, templates = cast(SearchableMotion, state.motion), state.templates
        cue_weights = self._fusion.adapt(state.distractor_ratios, self._adaptation)
        responses = self._fusion.responses_on_grid(region, search.grid, templates)
        centers = motion.center_prior(state.particles.states, prediction.interval)
        grid_log_likelihood = self._fusion.search(
            region, search.grid, responses, templates, cue_weights
        )
        if external_likelihood:
            grid_log_likelihood += external_likelihood(search.grid.by_axis).ravel()
        predicted, log_prior = search.propose(
            prediction.particles, motion, centers, grid_log_likelihood, frame_prediction.generator
        )
        boxes = motion.boxes(predicted.states)
        likelihood = self._log_likelihood(frame_prediction, boxes, cue_weights, external_likelihood)
        particles = predicted.reweight(likelihood)
        mean = mode_mean(particles, boxes, int(np.argmax(log_prior + likelihood)))
        box = motion.boxes(mean[None])[0]
        at_target = self._fusion.responses(region, box[None], templates)
        ratios = search.distractor_ratios(box, at_target, responses)
        distractor_box = None
        # The product of each cue's largest ratio bounds the product of all cues at one box.
        if ratios and math.prod(ratios.values()) >= _DISTRACTOR_ABOVE ** len(ratios):
            distractor_box = search.distractor_box(box, at_target, responses, _DISTRACTOR_ABOVE)
        seen, match = self._observe(frame_prediction, box)
        return Measurement(
            frame_prediction,
            particles,
            boxes,
            box,
            cue_weights,
            seen,
            match,
            distractor_ratios=smooth_distractor_ratios(state.distractor_ratios, ratios),
            second_peak=search.second_peak(box, grid_log_likelihood),
            distractor_box=distractor_box,
        )

    def covariance(
        self, measurement: Measurement, assessment: Assessment, time_since_seen: float
    ) -> NDArray[np.float64]:
        """See `Measurer.covariance`; given that the box is on the target, see `box_covariance`."""
        if measurement.frame_prediction.search is None:
            return super().covariance(measurement, assessment, time_since_seen)
        box, confidence = assessment.box, assessment.confidence
        if assessment.status.state == "tracking":
            return box_covariance(box, box_features(box, confidence))
        motion = cast(SearchableMotion, measurement.state.motion)
        random_walk_std = motion.random_walk_std(time_since_seen)
        return box_covariance(box, box_features(box, 0.0), random_walk_std)


def _grown(state: FilterState, prediction: Prediction, image_size: tuple[int, int]) -> Prediction:
    """The prediction, grown or shrunk as the last frame told, where it left no doubt.

    Sizes of the transition prior alone stay behind those of somebody who comes near.
    """
    log_growth = _GROWTH_GAIN * state.growth * (1.0 - state.doubt)
    if log_growth == 0.0:
        return prediction
    motion, particles = cast(SearchableMotion, state.motion), prediction.particles
    boxes = grown(motion.boxes(particles.states), math.exp(log_growth))
    states = motion.constrain(motion.with_boxes(particles.states, boxes), image_size)
    return prediction._replace(particles=particles.move(states))
