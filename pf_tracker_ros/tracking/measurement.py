"""What a frame says of the predicted particles: their weights, and the box that follows.

`Measurer` is the papers' way: every particle is weighed where the motion took it, and the estimate
is the mean. `SearchingMeasurer` looks all around the prediction first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.cues import CueFusion, Match
from pf_tracker_ros.cues.fusion import (
    CueWeights,
    DistractorRatios,
    Responses,
    Templates,
    smooth_distractor_ratios,
)
from pf_tracker_ros.filter import ParticleSet, ProposalParameters, SearchableMotion
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.prediction import Prediction
from pf_tracker_ros.tracking.search import Search, covariance_about, mode_mean

# What is known of a frame beside its pixels: log likelihoods of boxes, in their one shape.
ExternalLikelihood = Callable[[BoxesByAxis], NDArray[np.float64]]
# What looks so much like the target, 0 to 1, is a rival: the mean of what the cues say, multiplied.
_ALIKE_ABOVE = 0.5


class FramePrediction(NamedTuple):
    """A target in a frame that has not been looked at.

    Attributes:
        filter_state: Of the target, after the last frame.
        frame: The next one.
        interval: Seconds between them.
        prediction: The particles, as drawn for it.
        draw: Source of randomness from there on.
        boxes: (N, 4) of the particles, pixels.
        region: What of the frame is looked at.
        search: Where the target is looked for; None without a search.
    """

    filter_state: FilterState
    frame: Frame
    interval: float
    prediction: Prediction
    draw: np.random.Generator
    boxes: NDArray[np.float64]
    region: Region
    search: Search | None = None


class WeightedParticles(NamedTuple):
    """The particles of a frame, weighed by it.

    Attributes:
        frame_prediction: What was looked at.
        predicted: The particles before they were weighed.
        particles: The same, weighed.
        boxes: (N, 4) of the particles, pixels.
        cue_weights: Of the cues, in this frame.
        map_index: Number of the particle with the highest posterior density.
        responses: Name of a searchable cue to its (M,) strengths at the places of the search.
        grid_log_likelihood: (M,) log likelihoods of these places; empty without a search.
    """

    frame_prediction: FramePrediction
    predicted: ParticleSet
    particles: ParticleSet
    boxes: NDArray[np.float64]
    cue_weights: CueWeights
    map_index: int = 0
    responses: Responses = MappingProxyType({})
    grid_log_likelihood: NDArray[np.float64] = np.empty(0)


class Measurement(NamedTuple):
    """The particles of a frame, weighed by it, and what it shows at their estimate.

    Attributes:
        frame: That was looked at.
        predicted: The particles before they were weighed.
        particles: The same, weighed.
        boxes: (N, 4) of the particles, pixels.
        box: (4,) that they stand for, pixels.
        cue_weights: Of the cues, in this frame.
        seen: What each cue observes at the box.
        match: How well that fits the templates.
        distractor_ratios: How much of what is around has looked like the target lately.
        search: Where the target was looked for; None without a search.
        second_peak: (4,) likeliest box beside the target's, pixels; None without a search.
        distractor_box: (4,) box of what looks like the target beside it; None where nothing does, and
            without a search.
        transition_particles: The particles where the motion alone took them; None without a search.
    """

    frame: Frame
    predicted: ParticleSet
    particles: ParticleSet
    boxes: NDArray[np.float64]
    box: NDArray[np.float64]
    cue_weights: CueWeights
    seen: Templates
    match: Match
    distractor_ratios: DistractorRatios
    search: Search | None = None
    second_peak: NDArray[np.float64] | None = None
    distractor_box: NDArray[np.float64] | None = None
    transition_particles: ParticleSet | None = None

    @property
    def particle_std(self) -> float:
        """Standard deviation of the particles' centers, box sizes."""
        centers = self.boxes[:, :2] + self.boxes[:, 2:] / 2
        offsets = centers - self.particles.weights @ centers
        variance = self.particles.weights @ np.square(offsets).sum(axis=1)
        return math.sqrt(variance / (self.box[2] * self.box[3]))


class Measurer:
    """Weighs every particle where the motion took it; their mean is the estimate.

    Args:
        fusion: The cues.
        working_size: See `TrackerParameters`.
    """

    def __init__(self, fusion: CueFusion, working_size: int) -> None:
        self._fusion = fusion
        self._working_size = working_size

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> tuple[Templates, DistractorRatios]:
        """Templates of what is in a (4,) box, and how much of what is around looks like it."""
        return self.templates(frame, box), {}

    def templates(self, frame: Frame, box: NDArray[np.float64]) -> Templates:
        """Templates of what is in a (4,) box."""
        return self._fusion.learn(self._region(frame, box[None], box), box)

    def predict_frame(
        self,
        target: FilterState,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        draw: np.random.Generator,
        *,
        estimates_size: bool = True,
    ) -> FramePrediction:
        """What of a frame is to be looked at.

        Args:
            filter_state: Of the target, after the last frame.
            frame: The next one.
            interval: Seconds between them.
            prediction: For it.
            draw: Source of randomness from there on.
            estimates_size: See `Region`.
        """
        boxes = target.motion.boxes(prediction.particles.states)
        last_box = np.asarray(target.estimate.box)
        region = self._region(frame, boxes, last_box, estimates_size=estimates_size)
        return FramePrediction(target, frame, interval, prediction, draw, boxes, region)

    def weigh(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
    ) -> WeightedParticles:
        """The particles, weighed by the frame.

        Args:
            frame_prediction: Of the frame at hand.
            external_likelihood: One more factor of the likelihood; None where there is none.

        Source: Li et al. 2007, equation (8); Zhang et al. 2015, equation (10).
        """
        predicted, boxes = frame_prediction.prediction.particles, frame_prediction.boxes
        cue_weights = self._fusion.cue_weights
        likelihood = self._log_likelihood(frame_prediction, boxes, cue_weights, external_likelihood)
        return WeightedParticles(
            frame_prediction, predicted, predicted.reweight(likelihood), boxes, cue_weights
        )

    def _log_likelihood(
        self,
        frame_prediction: FramePrediction,
        boxes: NDArray[np.float64],
        cue_weights: CueWeights,
        external_likelihood: ExternalLikelihood | None,
    ) -> NDArray[np.float64]:
        """(N,) of (N, 4) boxes: that of the cues, and the evidence."""
        templates = frame_prediction.filter_state.templates
        likelihood = self._fusion.log_likelihood(
            frame_prediction.region, boxes, templates, cue_weights
        )
        return (
            likelihood + external_likelihood(BoxesByAxis(*boxes.T))
            if external_likelihood
            else likelihood
        )

    def estimate(self, weighed: WeightedParticles) -> Measurement:
        """The box that the particles stand for, and what the frame shows there.

        Source: Li et al. 2007, section 2.2; Zhang et al. 2015, equation (5).
        """
        box = weighed.frame_prediction.filter_state.motion.boxes(weighed.particles.mean[None])[0]
        return self._measured(weighed, box)

    def _measured(self, weighed: WeightedParticles, box: NDArray[np.float64]) -> Measurement:
        frame_prediction = weighed.frame_prediction
        seen = self._fusion.observe(frame_prediction.region, box)
        match = self._fusion.match(seen, frame_prediction.filter_state.templates)
        return Measurement(
            frame=frame_prediction.frame,
            predicted=weighed.predicted,
            particles=weighed.particles,
            boxes=weighed.boxes,
            box=box,
            cue_weights=weighed.cue_weights,
            seen=seen,
            match=match,
            distractor_ratios={},
        )

    def covariance(
        self,
        target: FilterState,
        measured: Measurement,
        assessment: Assessment,
        time_since_seen: float,
    ) -> NDArray[np.float64]:
        """(2, 2) covariance of the target's center, px^2.

        Args:
            filter_state: Of the target, after the last frame.
            measured: In this frame.
            assessment: What is told of the target.
            time_since_seen: Seconds without a sight of it that count.
        """
        return assessment.particles.covariance[:2, :2]

    def log_likelihoods(
        self, target: FilterState, frame: Frame, boxes: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Name of each cue to its (N,) log likelihoods of (N, 4) boxes of the target's size."""
        center_box = np.asarray(target.estimate.box)
        region = self._region(frame, boxes, center_box, center_box)
        return self._fusion.log_likelihoods(region, boxes, target.templates)

    def _region(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        center_box: NDArray[np.float64] | None = None,
        *,
        estimates_size: bool = True,
    ) -> Region:
        """What covers (N, 4) boxes, reduced as the size of a (4,) box asks for."""
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
    """Looks all around the prediction, and draws a share of the particles from what it finds.

    The estimate is the mean of one mode, and the cues' powers follow what is found beside it.

    Args:
        fusion: The cues, some of which can search.
        working_size: See `TrackerParameters`.
        parameters: Where to look, and the share.
        adaptation: How strongly the powers move, see `FusionParameters`.
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
        found = self._fusion.responses_on_grid(region, search.grid, templates)
        own = self._fusion.responses(region, box[None], templates)
        return templates, search.distractor_ratios(box, own, found)

    def search_window(self, frame: Frame, center_box: NDArray[np.float64]) -> tuple[Search, Region]:
        """A search around a (4,) box, and the region that it reads."""
        search = Search(center_box, self._parameters, frame.size)
        return search, self._region(frame, search.cover(center_box[None]), center_box, center_box)

    def predict_frame(
        self,
        target: FilterState,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        draw: np.random.Generator,
        *,
        estimates_size: bool = True,
    ) -> FramePrediction:
        """See `Measurer.predict_frame`."""
        if not self._fusion.searches(target.templates):
            # Cues that were just chosen have no template yet, and can't search in this frame.
            return super().predict_frame(
                target, frame, interval, prediction, draw, estimates_size=estimates_size
            )
        boxes = target.motion.boxes(prediction.particles.states)
        search = Search(prediction.particles.weights @ boxes, self._parameters, frame.size)
        last_box = np.asarray(target.estimate.box)
        region = self._region(
            frame,
            search.cover(boxes),
            last_box,
            search.center_box,
            estimates_size=estimates_size,
        )
        return FramePrediction(target, frame, interval, prediction, draw, boxes, region, search)

    def weigh(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
    ) -> WeightedParticles:
        """See `Measurer.weigh`; the weights carry p / q."""
        target, search, region = (
            frame_prediction.filter_state,
            frame_prediction.search,
            frame_prediction.region,
        )
        if search is None:
            return super().weigh(frame_prediction, external_likelihood)
        motion, prediction = cast(SearchableMotion, target.motion), frame_prediction.prediction
        cue_weights = self._fusion.adapt(target.distractor_ratios, self._adaptation)
        strengths = self._fusion.responses_on_grid(region, search.grid, target.templates)
        centers = motion.center_prior(target.particles.states, prediction.interval)
        grid_log_likelihood = self._fusion.search(
            region, search.grid, strengths, target.templates, cue_weights
        )
        if external_likelihood:
            grid_log_likelihood += external_likelihood(search.grid.by_axis).ravel()
        predicted, log_prior = search.propose(
            prediction.particles, motion, centers, grid_log_likelihood, frame_prediction.draw
        )
        boxes = motion.boxes(predicted.states)
        likelihood = self._log_likelihood(frame_prediction, boxes, cue_weights, external_likelihood)
        map_index = int(np.argmax(log_prior + likelihood))
        particles = predicted.reweight(likelihood)
        return WeightedParticles(
            frame_prediction,
            predicted,
            particles,
            boxes,
            cue_weights,
            map_index,
            strengths,
            grid_log_likelihood,
        )

    def estimate(self, weighed: WeightedParticles) -> Measurement:
        """See `Measurer.estimate`; the mean is that of the likeliest mode."""
        frame_prediction, strengths = weighed.frame_prediction, weighed.responses
        target, search = frame_prediction.filter_state, frame_prediction.search
        if search is None:
            return super().estimate(weighed)
        mean = mode_mean(weighed.particles, weighed.boxes, weighed.map_index)
        box = target.motion.boxes(mean[None])[0]
        own = self._fusion.responses(frame_prediction.region, box[None], target.templates)
        now = search.distractor_ratios(box, own, strengths)
        distractor_box = None
        # The most that single cues find bounds what all of them can find at one place.
        if math.prod(now.values()) >= _ALIKE_ABOVE ** len(now):
            distractor_box = search.distractor_box(box, own, strengths, _ALIKE_ABOVE)
        return self._measured(weighed, box)._replace(
            distractor_ratios=smooth_distractor_ratios(target.distractor_ratios, now),
            search=search,
            second_peak=search.second_peak(box, weighed.grid_log_likelihood),
            distractor_box=distractor_box,
            transition_particles=frame_prediction.prediction.particles,
        )

    def covariance(
        self,
        target: FilterState,
        measured: Measurement,
        assessment: Assessment,
        time_since_seen: float,
    ) -> NDArray[np.float64]:
        """See `Measurer.covariance`: about the box, anywhere else with what confidence lacks."""
        if measured.search is None:
            return super().covariance(target, measured, assessment, time_since_seen)
        center = assessment.box[:2] + assessment.box[2:] / 2
        within_mode = covariance_about(assessment.particles, center)
        is_hidden = assessment.status.state != "tracking"
        walk = (
            cast(SearchableMotion, target.motion).random_walk_std(time_since_seen)
            if is_hidden
            else None
        )
        return measured.search.covariance(within_mode, assessment.confidence, walk)
