"""One frame of tracking: predict, weigh, estimate, assess, learn, resample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.cues.fusion import Templates
from pf_tracker_ros.filter import KalmanFilter, ParticleSet, build_resampler
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.estimate import TrackState, TrackStatus
from pf_tracker_ros.tracking.filter_state import FilterState, SavedTemplates
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap, map_likelihood
from pf_tracker_ros.tracking.measurement import (
    ExternalLikelihood,
    FramePrediction,
    Measurement,
    Measurer,
    SearchingMeasurer,
)
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES
from pf_tracker_ros.tracking.parameter_checks import check_proposal
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.prediction import KalmanPredictor, Prediction, Predictor
from pf_tracker_ros.tracking.redetection import Candidate, Redetector
from pf_tracker_ros.tracking.state_operations import FilterInitializer, StateOperations
from pf_tracker_ros.tracking.track_assessor import TrackAssessor

# Seconds after which light that has jumped is there to stay.
_LASTS = 2.0


class _Learned(NamedTuple):
    """What a frame teaches.

    Attributes:
        templates: Of the target.
        kalman_filter: The Kalman filter, corrected where the target was seen.
        saved_templates: As of the target.
    """

    templates: Templates
    kalman_filter: KalmanFilter | None
    saved_templates: SavedTemplates | None


class TargetFilter:
    """Follows targets from frame to frame, as the parameters say.

    It holds what is made once for all targets, such as the cues, and nothing of any of them.

    Attributes:
        parameters: Every tunable.
        operations: Does with targets what is known beside the pixels.

    Args:
        parameters: Every tunable.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        chosen = {name: parameters.of_cues[name] for name in parameters.cues}
        self._fusion = CueFusion(
            {name: (CUES[name](own), own.weight) for name, own in chosen.items()}
        )
        check_proposal(parameters, self._fusion)
        self._confidence = Confidence(self._fusion, parameters.track.confidence_rate)
        self._predictor = Predictor()
        self._measurer = Measurer(self._fusion, parameters.working_size)
        self._redetector: Redetector | None = None
        proposal = parameters.proposal
        if proposal.method == "kalman":
            self._predictor = KalmanPredictor(proposal)
        elif proposal.method == "search":
            measurer = SearchingMeasurer(
                self._fusion,
                parameters.working_size,
                proposal,
                parameters.fusion.adaptation,
            )
            self._measurer = measurer
            self._redetector = Redetector(
                measurer,
                self._fusion,
                self._confidence,
                parameters.redetection,
                side=proposal.window,
                doubtful_below=parameters.track.occluded_below,
            )
        self._occlusion_policy = OCCLUSION_POLICIES[parameters.track.occlusion_policy]()
        self._initializer = FilterInitializer(parameters)
        self._assessor = TrackAssessor(
            self._confidence,
            self._occlusion_policy,
            self._redetector,
            self._initializer,
            parameters.track,
        )
        self.operations = StateOperations(
            self._predictor, self._measurer, self._initializer, parameters.track.lost_after
        )
        self._resampler = build_resampler(parameters.resampling)

    @property
    def needs_foreground(self) -> bool:
        """Whether `Frame.foreground` is asked for."""
        return self._fusion.needs_foreground

    def initialize(
        self,
        frame: Frame,
        first_box: Box,
        generator_state: GeneratorState,
        state: TrackState = "tracking",
    ) -> FilterState:
        """A target in its first frame.

        Args:
            frame: That it was drawn on.
            first_box: Of the target.
            generator_state: Its own.
            state: That it is in; another than tracking if the frame is one of before it went out of
                sight, so that the next one has to show it.
        """
        draw = generator_state.generator()
        motion = self._initializer.motion(first_box)
        particles = self._initializer.initial_particles(motion, frame.size, draw)
        box = np.array(first_box)
        templates, distractor_ratios = self._measurer.learn(frame, box)
        time_since_seen = self.parameters.track.lost_after if state == "lost" else 0.0
        track = TrackStatus(state, time_since_seen)
        confidence = 0.0 if state == "lost" else 1.0
        assessment = Assessment(box, confidence, track, particles, motion.boxes(particles.states))
        return FilterState(
            first_box=first_box,
            motion=motion,
            kalman_filter=self._initializer.kalman_filter(motion),
            particles=particles,
            templates=templates,
            first_templates=templates,
            distractor_ratios=distractor_ratios,
            status=assessment.status,
            last_seen_box=first_box,
            second_peak=None,
            known_distractor=None,
            frames_since_seen=0,
            followed_frames=0,
            generator_state=GeneratorState.of(draw),
            estimate=assessment.to_estimate(
                frame, self._fusion.cue_weights, particles.covariance[:2, :2]
            ),
        )

    def predict(
        self, targets: Sequence[tuple[FilterState, bool]], frame: Frame, interval: float
    ) -> list[FramePrediction]:
        """Where targets are expected in a frame; what can be computed for all at once is.

        Args:
            targets: After the last frame, each with whether the frame is asked for its size, too:
                not where others tell it, nor where it was asked a moment ago.
            frame: The next one.
            interval: Seconds since the last one.

        Source: Li et al. 2007, equation (3); Zhang et al. 2015, equation (7); Zhang Bo, section
        3.3.
        """
        frame_prediction = []
        for last, estimates_size in targets:
            draw = last.generator_state.generator()
            target = _in_the_light_of(frame, last, interval)
            prediction = self._predictor.predict(target, interval, frame.size, draw)
            frame_prediction.append(
                self._measurer.predict_frame(
                    target, frame, interval, prediction, draw, estimates_size=estimates_size
                )
            )
        self._fusion.precompute(
            [
                (one.region, one.filter_state.templates, one.filter_state.first_templates)
                for one in frame_prediction
            ]
        )
        return frame_prediction

    def step(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
        *,
        searches_everywhere: bool = True,
    ) -> FilterState:
        """The target in the frame that it was expected in.

        Args:
            frame_prediction: Of the frame.
            external_likelihood: What is known of the frame beside its pixels.
            searches_everywhere: Whether it is looked for all over the image once it is lost: not
                where somebody else tells where it is.

        Source: the steps of Li et al. 2007, section 3, Zhang et al. 2015, section 3.3, and Zhang
        Bo, section 3.3; `docs/papers.md` names the lines.
        """
        target, draw = frame_prediction.filter_state, frame_prediction.draw
        # Li (8), p = p_color^alpha p_texture^(1 - alpha); Zhang (10); Zhang Bo, step 3.
        weighed = self._measurer.weigh(frame_prediction, external_likelihood)
        # Zhang (5), the mean.
        measured = self._measurer.estimate(weighed)
        assessed = self._assessor.assess(
            target,
            measured,
            frame_prediction.interval,
            draw,
            searches_everywhere=searches_everywhere,
        )
        # Li (9) and (10), where p > w_Th; Zhang, section 3.3; Zhang Bo, the Kalman filter.
        learned = self._learn(target, frame_prediction.prediction, measured, assessed)
        # Zhang (6), below a threshold of the effective sample size; Zhang Bo, step 5.
        particles = self._resampler.resample(assessed.particles, self.parameters.particles, draw)
        return self._next(frame_prediction, measured, assessed, learned, particles)

    def _learn(
        self,
        target: FilterState,
        prediction: Prediction,
        measured: Measurement,
        assessment: Assessment,
    ) -> _Learned:
        """Templates and Kalman filter, moved to what was seen if that is to be trusted.

        Source: Li et al. 2007, equations (9) and (10), and w_Th; Zhang Bo, section 3.3.
        """
        templates, kalman_filter, earlier = (
            target.templates,
            prediction.kalman_filter,
            target.saved_templates,
        )
        rules, match, illumination = (
            self.parameters.template,
            measured.match,
            measured.frame.illumination,
        )
        goes_now = target.status.state == "tracking" and assessment.status.state != "tracking"
        if illumination.has_jumped and goes_now and rules.update_above < 1.0:
            # What was seen until now is still there, and only looks like nothing that was learned.
            earlier = SavedTemplates(templates, illumination.change)
            templates = self._measurer.templates(measured.frame, measured.box)
            return _Learned(templates, kalman_filter, earlier)
        if not assessment.learns:
            return _Learned(templates, kalman_filter, earlier)
        is_sure = match.similarity >= rules.required_similarity(target.followed_frames)
        if is_sure and math.exp(match.log_likelihood) > rules.update_above:
            templates = self._fusion.update(templates, measured.seen)
        if kalman_filter:
            kalman_filter = kalman_filter.correct(
                measured.particles.mean, measured.particles.covariance
            )
        return _Learned(templates, kalman_filter, earlier)

    def _next(
        self,
        frame_prediction: FramePrediction,
        measured: Measurement,
        assessment: Assessment,
        learned: _Learned,
        particles: ParticleSet,
    ) -> FilterState:
        """The target as the next frame finds it, with its resampled particles."""
        target, kalman_filter = frame_prediction.filter_state, learned.kalman_filter
        lost_after = self.parameters.track.lost_after
        is_seen = assessment.status.state == "tracking"
        if not is_seen:
            particles, kalman_filter = self._occlusion_policy.next_particles(
                target, assessment, particles, kalman_filter
            )
        # Once lost, the target may be anywhere; how long ago that was adds nothing.
        time_since_seen = min(assessment.status.time_since_seen, lost_after)
        covariance = self._measurer.covariance(target, measured, assessment, time_since_seen)
        estimate = assessment.to_estimate(measured.frame, measured.cue_weights, covariance)
        return FilterState(
            first_box=target.first_box,
            motion=target.motion,
            kalman_filter=kalman_filter,
            particles=particles,
            templates=learned.templates,
            first_templates={**learned.templates, **target.first_templates},
            distractor_ratios=measured.distractor_ratios,
            status=assessment.status,
            last_seen_box=estimate.box if is_seen else target.last_seen_box,
            second_peak=None if measured.second_peak is None else as_box(measured.second_peak),
            known_distractor=assessment.known_distractor,
            frames_since_seen=0 if is_seen else target.frames_since_seen + 1,
            followed_frames=target.followed_frames + 1,
            generator_state=GeneratorState.of(frame_prediction.draw),
            estimate=estimate,
            saved_templates=learned.saved_templates,
            distractor_box=measured.distractor_box,
        )

    def search_around(
        self, target: FilterState, frame: Frame, place: NDArray[np.float64]
    ) -> Candidate | None:
        """What is likeliest to be a target in a window around a (4,) box; the target stays.

        Returns:
            The box and the confidence in it; None where targets are not looked for elsewhere.
        """
        if self._redetector is None or self.parameters.redetection.windows == 0:
            return None
        return self._redetector.search_around(target, frame, target.estimate.cue_weights, place)

    def reconfigure(self, target: FilterState) -> FilterState:
        """A target that was followed with other parameters, to be followed with these.

        A cue that is left out forgets the target: added again, it may look at other things.
        """
        motion = self._initializer.motion(target.first_box)
        kalman_filter = self._initializer.kalman_filter(motion)
        if kalman_filter and target.kalman_filter:
            kalman_filter = replace(kalman_filter, belief=target.kalman_filter.belief)
        # A cue that is chosen again later may have other parameters, which a template depends on.
        known = self.parameters.cues
        return replace(
            target,
            motion=motion,
            kalman_filter=kalman_filter,
            templates={name: one for name, one in target.templates.items() if name in known},
            first_templates={
                name: one for name, one in target.first_templates.items() if name in known
            },
            distractor_ratios={
                name: one for name, one in target.distractor_ratios.items() if name in known
            },
            saved_templates=None,
        )

    def map_likelihood(self, target: FilterState, frame: Frame) -> LikelihoodMap:
        """How likely a target that was followed into a frame is around its box there."""
        return map_likelihood(
            target.estimate.box,
            frame.size,
            target.estimate.cue_weights,
            partial(self._measurer.log_likelihoods, target, frame),
        )


def _in_the_light_of(frame: Frame, target: FilterState, interval: float) -> FilterState:
    """A target as it looked before the light jumped, if that has been a flash."""
    earlier, illumination = target.saved_templates, frame.illumination
    if earlier is None:
        return target
    if illumination.has_jumped and (illumination.change > 1.0) != (earlier.change > 1.0):
        return replace(target, templates=earlier.templates, saved_templates=None)
    age = earlier.age + interval
    return replace(target, saved_templates=replace(earlier, age=age) if age < _LASTS else None)
