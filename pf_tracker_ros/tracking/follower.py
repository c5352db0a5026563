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
from pf_tracker_ros.filter import KalmanForesight, ParticleSet, build_resampler
from pf_tracker_ros.filter.particles import Randomness
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.estimate import Track, TrackState
from pf_tracker_ros.tracking.hiding import WHILE_HIDDEN
from pf_tracker_ros.tracking.judge import Judge
from pf_tracker_ros.tracking.judgment import Confidence, Judgment
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap, map_likelihood
from pf_tracker_ros.tracking.measurement import (
    Evidence,
    Expectation,
    Measurement,
    Measurer,
    SearchingMeasurer,
)
from pf_tracker_ros.tracking.parameter_checks import check_proposal
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.prediction import KalmanPredictor, Prediction, Predictor
from pf_tracker_ros.tracking.redetection import Found, Redetector
from pf_tracker_ros.tracking.steering import Beginning, Steering
from pf_tracker_ros.tracking.target import BeforeJump, Target

# Seconds after which light that has jumped is there to stay.
_LASTS = 2.0


class _Learned(NamedTuple):
    """What a frame teaches.

    Attributes:
        templates: Of the target.
        foresight: The Kalman filter, corrected where the target was seen.
        before_jump: As of the target.
    """

    templates: Templates
    foresight: KalmanForesight | None
    before_jump: BeforeJump | None


class Follower:
    """Follows targets from frame to frame, as the parameters say.

    It holds what is made once for all targets, such as the cues, and nothing of any of them.

    Attributes:
        parameters: Every tunable.
        steering: Does with targets what is known beside the pixels.

    Args:
        parameters: Every tunable.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        chosen = {name: parameters.of_cues[name] for name in parameters.cues}
        self._fusion = CueFusion(
            {name: (CUES[name](own), own.power) for name, own in chosen.items()}
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
        self._while_hidden = WHILE_HIDDEN[parameters.track.while_hidden]()
        self._beginning = Beginning(parameters)
        self._judge = Judge(
            self._confidence,
            self._while_hidden,
            self._redetector,
            self._beginning,
            parameters.track,
        )
        self.steering = Steering(
            self._predictor, self._measurer, self._beginning, parameters.track.lost_after
        )
        self._resampler = build_resampler(parameters.resampling)

    @property
    def needs_foreground(self) -> bool:
        """Whether `Frame.foreground` is asked for."""
        return self._fusion.needs_foreground

    def begin(
        self,
        frame: Frame,
        first_box: Box,
        randomness: Randomness,
        state: TrackState = "tracking",
    ) -> Target:
        """A target in its first frame.

        Args:
            frame: That it was drawn on.
            first_box: Of the target.
            randomness: Its own.
            state: That it is in; another than tracking if the frame is one of before it went out of
                sight, so that the next one has to show it.
        """
        draw = randomness.generator()
        motion = self._beginning.motion(first_box)
        particles = self._beginning.spread(motion, frame.size, draw)
        box = np.array(first_box)
        templates, distraction = self._measurer.learn(frame, box)
        hidden_for = self.parameters.track.lost_after if state == "lost" else 0.0
        track = Track(state, hidden_for)
        confidence = 0.0 if state == "lost" else 1.0
        judged = Judgment(box, confidence, track, particles, motion.boxes(particles.states))
        return Target(
            first_box=first_box,
            motion=motion,
            foresight=self._beginning.foresight(motion),
            particles=particles,
            templates=templates,
            first_templates=templates,
            distraction=distraction,
            track=judged.track,
            seen_box=first_box,
            runner_up=None,
            look_alike=None,
            hidden_frames=0,
            followed_frames=0,
            randomness=Randomness.of(draw),
            estimate=judged.estimate(frame, self._fusion.powers, particles.covariance[:2, :2]),
        )

    def predict(
        self, targets: Sequence[tuple[Target, bool]], frame: Frame, interval: float
    ) -> list[Expectation]:
        """Where targets are expected in a frame; what can be computed for all at once is.

        Args:
            targets: After the last frame, each with whether the frame is asked for its size, too:
                not where others tell it, nor where it was asked a moment ago.
            frame: The next one.
            interval: Seconds since the last one.

        Source: Li et al. 2007, equation (3); Zhang et al. 2015, equation (7); Zhang Bo, section
        3.3.
        """
        expected = []
        for last, looks_for_size in targets:
            draw = last.randomness.generator()
            target = _in_the_light_of(frame, last, interval)
            prediction = self._predictor.predict(target, interval, frame.size, draw)
            expected.append(
                self._measurer.expect(
                    target, frame, interval, prediction, draw, looks_for_size=looks_for_size
                )
            )
        self._fusion.prepare(
            [(one.region, one.target.templates, one.target.first_templates) for one in expected]
        )
        return expected

    def step(
        self,
        expected: Expectation,
        evidence: Evidence | None = None,
        *,
        searches_everywhere: bool = True,
    ) -> Target:
        """The target in the frame that it was expected in.

        Args:
            expected: Of the frame.
            evidence: What is known of the frame beside its pixels.
            searches_everywhere: Whether it is looked for all over the image once it is lost: not
                where somebody else tells where it is.

        Source: the steps of Li et al. 2007, section 3, Zhang et al. 2015, section 3.3, and Zhang
        Bo, section 3.3; `docs/papers.md` names the lines.
        """
        target, draw = expected.target, expected.draw
        # Li (8), p = p_color^alpha p_texture^(1 - alpha); Zhang (10); Zhang Bo, step 3.
        weighed = self._measurer.weigh(expected, evidence)
        # Zhang (5), the mean.
        measured = self._measurer.estimate(weighed)
        assessed = self._judge.judge(
            target, measured, expected.interval, draw, searches_everywhere=searches_everywhere
        )
        # Li (9) and (10), where p > w_Th; Zhang, section 3.3; Zhang Bo, the Kalman filter.
        learned = self._learn(target, expected.prediction, measured, assessed)
        # Zhang (6), below a threshold of the effective sample size; Zhang Bo, step 5.
        particles = self._resampler.resample(assessed.particles, self.parameters.particles, draw)
        return self._next(expected, measured, assessed, learned, particles)

    def _learn(
        self, target: Target, prediction: Prediction, measured: Measurement, judged: Judgment
    ) -> _Learned:
        """Templates and Kalman filter, moved to what was seen if that is to be trusted.

        Source: Li et al. 2007, equations (9) and (10), and w_Th; Zhang Bo, section 3.3.
        """
        templates, foresight, earlier = target.templates, prediction.foresight, target.before_jump
        rules, match, light = self.parameters.template, measured.match, measured.frame.light
        goes_now = target.track.state == "tracking" and judged.track.state != "tracking"
        if light.has_jumped and goes_now and rules.update_above < 1.0:
            # What was seen until now is still there, and only looks like nothing that was learned.
            earlier = BeforeJump(templates, light.change)
            templates = self._measurer.templates(measured.frame, measured.box)
            return _Learned(templates, foresight, earlier)
        if not judged.learns:
            return _Learned(templates, foresight, earlier)
        is_sure = match.similarity >= rules.similarity_asked(target.followed_frames)
        if is_sure and math.exp(match.log_likelihood) > rules.update_above:
            templates = self._fusion.update(templates, measured.seen)
        if foresight:
            foresight = foresight.correct(measured.particles.mean, measured.particles.covariance)
        return _Learned(templates, foresight, earlier)

    def _next(
        self,
        expected: Expectation,
        measured: Measurement,
        judged: Judgment,
        learned: _Learned,
        particles: ParticleSet,
    ) -> Target:
        """The target as the next frame finds it, with its resampled particles."""
        target, foresight = expected.target, learned.foresight
        lost_after = self.parameters.track.lost_after
        is_seen = judged.track.state == "tracking"
        if not is_seen:
            particles, foresight = self._while_hidden.go_on(target, judged, particles, foresight)
        # Once lost, the target may be anywhere; how long ago that was adds nothing.
        hidden_for = min(judged.track.hidden_for, lost_after)
        covariance = self._measurer.covariance(target, measured, judged, hidden_for)
        estimate = judged.estimate(measured.frame, measured.powers, covariance)
        return Target(
            first_box=target.first_box,
            motion=target.motion,
            foresight=foresight,
            particles=particles,
            templates=learned.templates,
            first_templates={**learned.templates, **target.first_templates},
            distraction=measured.distraction,
            track=judged.track,
            seen_box=estimate.box if is_seen else target.seen_box,
            runner_up=None if measured.runner_up is None else as_box(measured.runner_up),
            look_alike=judged.look_alike,
            hidden_frames=0 if is_seen else target.hidden_frames + 1,
            followed_frames=target.followed_frames + 1,
            randomness=Randomness.of(expected.draw),
            estimate=estimate,
            before_jump=learned.before_jump,
            rival=measured.rival,
        )

    def look_elsewhere(
        self, target: Target, frame: Frame, place: NDArray[np.float64]
    ) -> Found | None:
        """What is likeliest to be a target in a window around a (4,) box; the target stays.

        Returns:
            The box and the confidence in it; None where targets are not looked for elsewhere.
        """
        if self._redetector is None or self.parameters.redetection.windows == 0:
            return None
        return self._redetector.look(target, frame, target.estimate.powers, place)

    def reconfigure(self, target: Target) -> Target:
        """A target that was followed with other parameters, to be followed with these.

        A cue that is left out forgets the target: added again, it may look at other things.
        """
        motion = self._beginning.motion(target.first_box)
        foresight = self._beginning.foresight(motion)
        if foresight and target.foresight:
            foresight = replace(foresight, belief=target.foresight.belief)
        # A cue that is chosen again later may have other parameters, which a template depends on.
        known = self.parameters.cues
        return replace(
            target,
            motion=motion,
            foresight=foresight,
            templates={name: one for name, one in target.templates.items() if name in known},
            first_templates={
                name: one for name, one in target.first_templates.items() if name in known
            },
            distraction={name: one for name, one in target.distraction.items() if name in known},
            before_jump=None,
        )

    def map_likelihood(self, target: Target, frame: Frame) -> LikelihoodMap:
        """How likely a target that was followed into a frame is around its box there."""
        return map_likelihood(
            target.estimate.box,
            frame.size,
            target.estimate.powers,
            partial(self._measurer.log_likelihoods, target, frame),
        )


def _in_the_light_of(frame: Frame, target: Target, interval: float) -> Target:
    """A target as it looked before the light jumped, if that has been a flash."""
    earlier, light = target.before_jump, frame.light
    if earlier is None:
        return target
    if light.has_jumped and (light.change > 1.0) != (earlier.change > 1.0):
        return replace(target, templates=earlier.templates, before_jump=None)
    age = earlier.age + interval
    return replace(target, before_jump=replace(earlier, age=age) if age < _LASTS else None)
