"""The particle filter of a target: one step for each frame.

Weighted particles represent the distribution of the target's box. Each frame updates them:

1. Predict: draw each particle x_t from the motion model, or from a proposal q with the weight
   times p(x_t | x_{t-1}) / q. Li (3); Zhang (7); Zhang Bo, section 3.3.
2. Weigh: multiply each weight by the likelihood of the frame, which fuses the cues k to
   p = prod_k p_k^alpha_k, in `CueFusion.log_likelihood`. Li (8); Zhang (10); Zhang Bo, step 3.
3. Estimate: take the weighted mean. Li, section 1; Zhang (5); Zhang Bo, step 4.
4. Assess: compute the confidence and the track state, and redetect a target out of sight. No paper.
5. Learn: blend the templates with the trusted estimate, q_t = beta q_{t-1} + (1 - beta) p, and
   correct the Kalman filter. Li (9), (10) and w_Th; Zhang, section 3.3; Zhang Bo, section 3.3.
6. Resample: where the effective sample size is low, draw particles in proportion to their weights.
   Zhang (6); Zhang Bo, step 5.

`TargetFilter.predict` is step 1, for all targets at once; `TargetFilter.step` is steps 2 to 6.
Sources: Li et al. 2007, Zhang et al. 2015 and Zhang Bo, equation by equation in `docs/papers.md`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.cues.hog import direction_table
from pf_tracker_ros.filter import ParticleSet, build_resampler
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Assessment, Confidence, ConfidenceCalibration
from pf_tracker_ros.tracking.box_covariance import particle_covariance
from pf_tracker_ros.tracking.estimate import TrackState, TrackStatus
from pf_tracker_ros.tracking.exemplars import Exemplars
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
from pf_tracker_ros.tracking.oriented_gradients import BINS
from pf_tracker_ros.tracking.parameters import TrackerParameters, check_proposal
from pf_tracker_ros.tracking.prediction import KalmanPredictor, Predictor
from pf_tracker_ros.tracking.redetection import Candidate, Redetector
from pf_tracker_ros.tracking.state_operations import FilterInitializer, StateOperations
from pf_tracker_ros.tracking.track_assessor import TrackAssessor
from pf_tracker_ros.values import replace

# Seconds after which a jump of the illumination is permanent and no flash.
_LONGEST_FLASH = 2.0


RISING_SHARE = 0.2
"""Share of each frame in the confidence while it rises, with a search: several have to agree."""


class TargetFilter:
    """Particle filter with cues, templates and a track state.

    It holds the parts that all targets share, such as the cues. All that belongs to one target is
    in its `FilterState`.

    Attributes:
        operations: Changes of a state by external information, such as detections.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        selected = {name: parameters.of_cues[name] for name in parameters.cues}
        self._fusion = CueFusion(
            {name: (CUES[name](values), values.weight) for name, values in selected.items()}
        )
        check_proposal(parameters, self._fusion)
        proposal = parameters.proposal
        searches = proposal.method == "search"
        self._confidence = Confidence(self._fusion, RISING_SHARE if searches else 1.0)
        self._calibration = ConfidenceCalibration.of(parameters.track.confidence_calibration)
        self._predictor = KalmanPredictor(proposal) if proposal.method == "kalman" else Predictor()
        self._measurer = Measurer(self._fusion, parameters.working_size)
        self._redetector: Redetector | None = None
        if searches:
            measurer = SearchingMeasurer(
                self._fusion, parameters.working_size, proposal, parameters.fusion.adaptation
            )
            self._measurer = measurer
            self._redetector = Redetector(
                measurer,
                self._fusion,
                self._confidence,
                parameters.redetection,
                side=proposal.window,
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
            self._predictor,
            self._measurer,
            self._initializer,
            parameters.track.lost_after,
            self._calibration,
        )
        self._resampler = build_resampler(parameters.resampling)
        # In advance: it takes the time of several frames.
        direction_table(BINS)

    @property
    def needs_foreground(self) -> bool:
        """Whether a cue reads `Frame.foreground`."""
        return self._fusion.needs_foreground

    def initialize(
        self,
        frame: Frame,
        first_box: Box,
        generator_state: GeneratorState,
        track_state: TrackState = "tracking",
    ) -> FilterState:
        """State of a target in its first frame.

        Another track state than "tracking" has to be confirmed by the next frame.
        """
        generator = generator_state.generator()
        motion = self._initializer.motion(first_box)
        particles = self._initializer.initial_particles(motion, frame.size, generator)
        box = np.array(first_box)
        templates, distractor_ratios = self._measurer.learn(frame, box)
        is_lost = track_state == "lost"
        status = TrackStatus(track_state, self.parameters.track.lost_after if is_lost else 0.0)
        boxes = motion.boxes(particles.states)
        assessment = Assessment(box, 0.0 if is_lost else 1.0, status, particles, boxes)
        covariance = particle_covariance(particles, boxes)
        return FilterState(
            first_box=first_box,
            motion=motion,
            kalman_filter=self._initializer.kalman_filter(motion),
            particles=particles,
            templates=templates,
            exemplars=Exemplars.of(frame, box),
            distractor_ratios=distractor_ratios,
            status=status,
            last_seen_box=first_box,
            generator_state=GeneratorState.of(generator),
            confidence=assessment.confidence,
            estimate=assessment.to_estimate(
                frame, self._fusion.cue_weights, covariance, self._calibration
            ),
        )

    def predict(
        self, targets: Sequence[tuple[FilterState, bool]], frame: Frame, interval: float
    ) -> list[FramePrediction]:
        """Step 1: particles of each target in the next frame; the cues precompute for all at once.

        Each target is its state after the last frame, and whether to estimate its size.

        Source: Li et al. 2007, equation (3); Zhang et al. 2015, equation (7); Zhang Bo, section
        3.3.
        """
        frame_predictions = []
        for last, estimates_size in targets:
            generator = last.generator_state.generator()
            state = _restored_after_flash(last, frame, interval)
            prediction = self._predictor.predict(state, interval, frame.size, generator)
            frame_predictions.append(
                self._measurer.predict_frame(
                    state, frame, interval, prediction, generator, estimates_size=estimates_size
                )
            )
        self._fusion.precompute(
            [(one.region, one.filter_state.templates) for one in frame_predictions]
        )
        return frame_predictions

    def step(
        self,
        frame_prediction: FramePrediction,
        external_likelihood: ExternalLikelihood | None = None,
        *,
        searches_everywhere: bool = True,
        is_challenged: bool = True,
    ) -> FilterState:
        """Steps 2 to 6: state of a target after the predicted frame.

        The external likelihood is one more factor, such as that of a detection. A lost target is
        searched all over the image (`searches_everywhere`) unless a detector or the appearance does
        that. See `TrackAssessor.assess` for the challenge.

        Source: Li et al. 2007, section 3; Zhang et al. 2015, section 3.3; Zhang Bo, section 3.3.
        """
        # 2. Weigh. Li (8): p = p_color^alpha p_texture^(1 - alpha); Zhang (10); Zhang Bo, step 3.
        # 3. Estimate. Zhang (5): the weighted mean; Zhang Bo, step 4.
        measurement = self._measurer.measure(frame_prediction, external_likelihood)
        # 4. Assess: confidence, track state and redetection.
        assessment = self._assessor.assess(
            measurement, searches_everywhere=searches_everywhere, is_challenged=is_challenged
        )
        # 5. Learn. Li (9) and (10) where p > w_Th; Zhang, section 3.3; Zhang Bo, Kalman filter.
        learned = self._learn(measurement, assessment)
        # 6. Resample. Zhang (6), below a threshold of the effective sample size; Zhang Bo, step 5.
        particles = self._resampler.resample(
            assessment.particles, self.parameters.particles, frame_prediction.generator
        )
        following = self._next_state(measurement, assessment, learned, particles)
        if learned.standing is not None:
            growth = self._measurer.log_growth(frame_prediction, measurement.box)
            return replace(following, growth=growth)
        return following

    def _learn(self, measurement: Measurement, assessment: Assessment) -> FilterState:
        """The state with what is learned from a trusted estimate.

        The templates are blended with it, it corrects the Kalman filter, and it may be an exemplar.

        Source: Li et al. 2007, equations (9) and (10), and w_Th; Zhang Bo, section 3.3.
        """
        state, frame = measurement.state, measurement.frame
        templates = state.templates
        kalman_filter = measurement.frame_prediction.prediction.kalman_filter
        rules, match, illumination = self.parameters.template, measurement.match, frame.illumination
        status = assessment.status
        disappears = state.status.state == "tracking" and status.state != "tracking"
        if illumination.has_jumped and disappears and rules.update_above < 1.0:
            # The target is still there and matches no template: learn its new appearance at once.
            return replace(
                state,
                templates=self._measurer.templates(frame, measurement.box),
                kalman_filter=kalman_filter,
                saved_templates=SavedTemplates(templates, illumination.change),
            )
        if assessment.learns:
            is_similar = match.similarity >= rules.required_similarity(state.followed_frames)
            if is_similar and math.exp(match.log_likelihood) > rules.update_above:
                templates = self._fusion.update(templates, measurement.seen)
            if kalman_filter:
                kalman_filter = kalman_filter.correct(
                    measurement.particles.mean, measurement.particles.covariance
                )
        exemplars = state.exemplars
        if self._redetector and status.state == "tracking" and status.hidden_for == 0.0:
            interval = measurement.frame_prediction.interval
            exemplars = exemplars.update(frame, assessment.box, interval, assessment.confidence)
        return replace(state, templates=templates, kalman_filter=kalman_filter, exemplars=exemplars)

    def _next_state(
        self,
        measurement: Measurement,
        assessment: Assessment,
        learned: FilterState,
        particles: ParticleSet,
    ) -> FilterState:
        """State for the next frame, with the resampled particles."""
        state, kalman_filter = measurement.state, learned.kalman_filter
        is_seen = assessment.status.state == "tracking"
        if not is_seen:
            particles, kalman_filter = self._occlusion_policy.next_particles(
                state, assessment, particles, kalman_filter
            )
        # A lost target may be anywhere, however long ago it was lost.
        time_since_seen = min(assessment.status.time_since_seen, self.parameters.track.lost_after)
        covariance = self._measurer.covariance(measurement, assessment, time_since_seen)
        estimate = assessment.to_estimate(
            measurement.frame, measurement.cue_weights, covariance, self._calibration
        )
        second_peak = measurement.second_peak
        return replace(
            learned,
            kalman_filter=kalman_filter,
            particles=particles,
            distractor_ratios=measurement.distractor_ratios,
            status=assessment.status,
            last_seen_box=estimate.box if is_seen else state.last_seen_box,
            second_peak=None if second_peak is None else as_box(second_peak),
            known_distractor=assessment.known_distractor,
            frames_since_seen=0 if is_seen else state.frames_since_seen + 1,
            followed_frames=state.followed_frames + 1,
            generator_state=GeneratorState.of(measurement.frame_prediction.generator),
            confidence=assessment.confidence,
            estimate=estimate,
            distractor_box=measurement.distractor_box,
            occlusion_evidence=state.occlusion_evidence.advance(
                measurement.frame_prediction.interval
            ),
            challenger=assessment.challenger,
            standing=None,
            place_factor=1.0,
            growth=0.0,
        )

    def search_around(
        self, state: FilterState, frame: Frame, box: NDArray[np.float64]
    ) -> Candidate | None:
        """Likeliest candidate in a window around a (4,) box; None where redetection is off."""
        if self._redetector is None or self.parameters.redetection.windows == 0:
            return None
        return self._redetector.search_around(state, frame, state.estimate.cue_weights, box)

    def reconfigure(self, state: FilterState) -> FilterState:
        """A state from a filter with other parameters, converted for this one.

        The template of a cue that is left out is deleted: selected again later, the cue may have
        other parameters, which a template depends on.
        """
        motion = self._initializer.motion(state.first_box)
        kalman_filter = self._initializer.kalman_filter(motion)
        if kalman_filter and state.kalman_filter:
            kalman_filter = replace(kalman_filter, belief=state.kalman_filter.belief)

        def of_selected(values: Mapping[str, Any]) -> dict[str, Any]:
            return {name: value for name, value in values.items() if name in self.parameters.cues}

        return replace(
            state,
            motion=motion,
            kalman_filter=kalman_filter,
            templates=of_selected(state.templates),
            distractor_ratios=of_selected(state.distractor_ratios),
            saved_templates=None,
        )

    def map_likelihood(self, state: FilterState, frame: Frame) -> LikelihoodMap:
        """Likelihood around the box of a target, in the frame that the state is of."""
        return map_likelihood(
            state.estimate.box,
            frame.size,
            state.estimate.cue_weights,
            partial(self._measurer.log_likelihoods, state, frame),
        )


def _restored_after_flash(state: FilterState, frame: Frame, interval: float) -> FilterState:
    """The state with the templates from before a jump of the illumination that ends here."""
    saved, illumination = state.saved_templates, frame.illumination
    if saved is None:
        return state
    if illumination.has_jumped and (illumination.change > 1.0) != (saved.change > 1.0):
        return replace(state, templates=saved.templates, saved_templates=None)
    age = saved.age + interval
    is_flash = age < _LONGEST_FLASH
    return replace(state, saved_templates=replace(saved, age=age) if is_flash else None)


def default_numpy_errors() -> np.errstate:
    """NumPy's default error handling, whatever the calling program has set.

    Likelihoods far from the target underflow, an error under `numpy.seterr(all="raise")`.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
