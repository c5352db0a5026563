"""One frame of tracking: predict, measure, judge, learn, advance."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundParameters
from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.cues.fusion import Powers, Templates
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    ForeseenMotion,
    KalmanForesight,
    MotionModel,
    ParticleSet,
    build_resampler,
)
from pf_tracker_ros.filter.randomness import Randomness
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.confidence import Confidence
from pf_tracker_ros.tracking.estimate import Estimate, FrozenPowers, TrackState
from pf_tracker_ros.tracking.hiding import WHILE_HIDDEN
from pf_tracker_ros.tracking.judgment import Judgment
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap, map_likelihood
from pf_tracker_ros.tracking.measurement import (
    Evidence,
    Measurement,
    Measurer,
    SearchingMeasurer,
)
from pf_tracker_ros.tracking.parameter_checks import check_proposal
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.prediction import KalmanPredictor, Prediction, Predictor
from pf_tracker_ros.tracking.redetection import Found, Redetector
from pf_tracker_ros.tracking.target import Target
from pf_tracker_ros.tracking.track_state import Track

# Confidence that a frame alone must give for anything to be learned of it, however the cues' own
# similarity is.
_LEARN_ABOVE = 0.01


class _Learned(NamedTuple):
    """What a frame teaches.

    Attributes:
        templates: Of the target.
        foresight: The Kalman filter, corrected where the target was seen.
    """

    templates: Templates
    foresight: KalmanForesight | None


class Follower:
    """Follows targets from frame to frame, as the parameters say.

    It holds what is made once for all targets, such as the cues, and nothing of any of them.

    Args:
        parameters: Every tunable.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        powers = {name: of_cue.power for name, of_cue in parameters.of_powers.items()}
        self._fusion = CueFusion(
            {
                name: (CUES[name](of_cue), powers.get(name, 1.0))
                for name, of_cue in parameters.of_cues.items()
            }
        )
        check_proposal(parameters, self._fusion)
        self._confidence = Confidence(self._fusion, parameters.track.confidence_rate)
        self._predictor = Predictor()
        self._measurer = Measurer(self._fusion, parameters.working_size)
        self._redetector: Redetector | None = None
        method, own = parameters.proposal.method, parameters.proposal.of_method[""]
        if method == "kalman":
            self._predictor = KalmanPredictor(own)
        elif method == "search":
            adaptation = parameters.of_search["fusion"].adaptation
            measurer = SearchingMeasurer(self._fusion, parameters.working_size, own, adaptation)
            self._measurer = measurer
            self._redetector = Redetector(
                measurer,
                self._fusion,
                self._confidence,
                parameters.of_search["redetection"],
                side=own.window,
                doubtful_below=parameters.track.occluded_below,
            )
        self._while_hidden = WHILE_HIDDEN[parameters.track.while_hidden]()
        self._resampler = build_resampler(parameters.resampling)

    @property
    def needs_foreground(self) -> bool:
        """Whether `Frame.foreground` is asked for."""
        return self._fusion.needs_foreground

    @property
    def background(self) -> BackgroundParameters | None:
        """Of the background model that the foreground comes from; None where it is not needed."""
        return self.parameters.of_background["background"] if self.needs_foreground else None

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
        motion = self._motion(first_box)
        particles = self._spread(motion, frame, draw)
        box = np.array(first_box)
        templates, distraction = self._measurer.learn(frame, box)
        hidden_for = self.parameters.track.lost_after if state == "lost" else 0.0
        track = Track(state, hidden_for)
        judged = Judgment(box, 1.0, track, particles, motion.boxes(particles.states))
        return Target(
            first_box=first_box,
            motion=motion,
            foresight=self._foresight(motion),
            particles=particles,
            templates=templates,
            first_templates=templates,
            distraction=distraction,
            track=judged.track,
            seen_box=first_box,
            hidden_frames=0,
            followed_frames=0,
            randomness=Randomness.of(draw),
            estimate=_estimate(
                judged, frame, self._fusion.powers, judged.particles.covariance[:2, :2]
            ),
        )

    def reconfigure(self, target: Target) -> Target:
        """A target that was followed with other parameters, to be followed with these.

        A cue that is left out forgets the target: added again, it may look at other things.
        """
        motion = self._motion(target.first_box)
        foresight = self._foresight(motion)
        if foresight and target.foresight:
            foresight = replace(foresight, belief=target.foresight.belief)
        # A cue that is chosen again later may have other parameters, which a template depends on.
        known = self.parameters.of_cues
        return replace(
            target,
            motion=motion,
            foresight=foresight,
            templates={name: one for name, one in target.templates.items() if name in known},
            first_templates={
                name: one for name, one in target.first_templates.items() if name in known
            },
            distraction={name: one for name, one in target.distraction.items() if name in known},
        )

    def follow(
        self, target: Target, frame: Frame, interval: float, evidence: Evidence | None = None
    ) -> Target:
        """The target one frame later.

        Args:
            target: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
            evidence: What is known of the frame beside its pixels.

        Source: the steps of Li et al. 2007, section 3, Zhang et al. 2015, section 3.3, and Zhang
        Bo, section 3.3; `docs/papers.md` names the lines.
        """
        draw = target.randomness.generator()
        prediction = self._predictor.predict(target, interval, frame.size, draw)
        measured = self._measurer.measure(target, frame, prediction, draw, evidence)
        judged = self._judge(target, measured, interval, draw)
        learned = self._learn(target, prediction, measured, judged)
        return self._advance(target, measured, judged, learned, draw)

    def map_likelihood(self, target: Target, frame: Frame) -> LikelihoodMap:
        """How likely a target that was followed into a frame is around its box there."""
        return map_likelihood(
            target.estimate.box,
            frame.size,
            target.estimate.powers,
            partial(self._measurer.log_likelihoods, target, frame),
        )

    def coast(self, target: Target, frame: Frame, interval: float) -> Target:
        """The target one frame later, where the motion model alone takes it.

        For a frame that is known not to show it: nothing is looked at, and nothing learned.

        Args:
            target: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
        """
        draw = target.randomness.generator()
        prediction = self._predictor.predict(target, interval, frame.size, draw)
        particles, motion = prediction.particles, target.motion
        boxes = motion.boxes(particles.states)
        box = motion.boxes(particles.mean[None])[0]
        hidden_for = target.track.hidden_for + interval
        track = Track("occluded", min(hidden_for, self.parameters.track.lost_after))
        judged = Judgment(box, target.estimate.confidence, track, particles, boxes)
        covariance = particles.covariance[:2, :2].copy()
        estimate = _estimate(judged, frame, target.estimate.powers, covariance)
        return replace(
            target,
            foresight=prediction.foresight,
            particles=particles,
            track=track,
            hidden_frames=target.hidden_frames + 1,
            followed_frames=target.followed_frames + 1,
            randomness=Randomness.of(draw),
            estimate=estimate,
        )

    def move(self, target: Target, box: Box) -> Target:
        """The target with its particles brought along to another box; they keep their velocities.

        Args:
            target: As the frame at hand left it.
            box: Where it is in that frame.
        """
        before = np.array(target.estimate.box)
        size, after = before[2:], np.array(box)
        shift = after[:2] + after[2:] / 2 - before[:2] - size / 2
        factor = after[2:] / size
        states = target.particles.states.copy()
        columns = target.motion.columns
        for axis, (place, side) in enumerate((("x", "width"), ("y", "height"))):
            for name in (place, f"earlier_{place}"):
                if name in columns:
                    states[:, columns.index(name)] += shift[axis]
            for name in (side, f"earlier_{side}"):
                if name in columns:
                    states[:, columns.index(name)] *= factor[axis]
        motion = target.motion if "width" in columns else self._motion(box)
        particles = target.particles.move(states)
        told = target.estimate
        boxes = told.particle_boxes + np.hstack([shift, 0.0, 0.0])
        return replace(
            target,
            motion=motion,
            particles=particles,
            seen_box=box if target.track.state == "tracking" else target.seen_box,
            estimate=replace(told, box=box, particle_boxes=boxes),
        )

    def relearn(self, target: Target, frame: Frame) -> Target:
        """The target with templates of what is in its box now, as if it was first seen here."""
        templates = self._measurer.templates(frame, np.array(target.estimate.box))
        return replace(target, templates=templates, first_templates=templates)

    def _judge(
        self, target: Target, measured: Measurement, interval: float, draw: np.random.Generator
    ) -> Judgment:
        """Whether the target is seen; if not, what is told of it, or where it is found again."""
        thresholds = self.parameters.track
        now = self._confidence.judge(target, measured.seen, measured.match, measured.spread)
        confidence = self._confidence.update(target.estimate.confidence, now)
        # While it looks as it did last, it is not lost, whatever it looked like first.
        glimpse = max(now, measured.match.similarity)
        track = target.track.advance(confidence, glimpse, interval, thresholds)
        if self._redetector is None:
            # Nobody looks for another.
            track = replace(track, probation=0.0)
        # The best place around may be like the target, and the box beside it.
        learns = self._redetector is None or now >= _LEARN_ABOVE
        judged = Judgment(
            measured.box, confidence, track, measured.particles, measured.boxes, learns
        )
        if track.is_settled:
            return judged
        is_seen, box = track.state == "tracking", None
        if not is_seen:
            judged = self._while_hidden.judge(target, measured, judged)
            box = self._while_hidden.begin_anew(target, judged)
        if track.state != "occluded" or track.probation:
            # What looks like it elsewhere may be the target, what is followed something else.
            judged = replace(judged, learns=False)
        if not is_seen and now > thresholds.recovered_above:
            return judged
        found = self._find(target, measured, judged, now if is_seen else 0.0)
        if found is not None:
            box, judged = found.box, self._believe(found, judged)
        if box is None:
            return judged
        motion = self._motion(as_box(box))
        particles = self._spread(motion, measured.frame, draw)
        boxes = motion.boxes(particles.states)
        return replace(judged, box=box, particles=particles, boxes=boxes, learns=False)

    def _find(
        self, target: Target, measured: Measurement, judged: Judgment, rival: float
    ) -> Found | None:
        """The target elsewhere; see `Redetector.find`."""
        if self._redetector is None:
            return None
        everywhere = judged.track.state != "occluded"
        return self._redetector.find(target, measured, judged.box, everywhere, rival)

    def _believe(self, found: Found, judged: Judgment) -> Judgment:
        """What is told once the target is found elsewhere.

        Where it went out of sight a moment ago it is that. After a longer time it may be something
        like it: then it counts as lost until more frames agree.
        """
        track = judged.track
        if track.state == "tracking":
            return replace(judged, confidence=0.0, track=track.lose(self.parameters.track))
        if track.state == "occluded" and not track.probation:
            return replace(judged, confidence=found.confidence, track=Track())
        return judged

    def _learn(
        self, target: Target, prediction: Prediction, measured: Measurement, judged: Judgment
    ) -> _Learned:
        """Templates and Kalman filter, moved to what was seen if that is to be trusted.

        Source: Li et al. 2007, equations (9) and (10), and w_Th; Zhang Bo, section 3.3.
        """
        templates, foresight = target.templates, prediction.foresight
        if not judged.learns:
            return _Learned(templates, foresight)
        rules, match = self.parameters.template, measured.match
        is_sure = match.similarity >= rules.confidence_asked(target.followed_frames)
        if is_sure and math.exp(match.log_likelihood) > rules.update_above:
            templates = self._fusion.update(templates, measured.seen)
        if foresight:
            foresight = foresight.correct(measured.particles.mean, measured.particles.covariance)
        return _Learned(templates, foresight)

    def _advance(
        self,
        target: Target,
        measured: Measurement,
        judged: Judgment,
        learned: _Learned,
        draw: np.random.Generator,
    ) -> Target:
        """The target as the next frame finds it, its particles resampled.

        Source: Zhang et al. 2015, equation (6) and section 3.3; Zhang Bo, step 5.
        """
        parameters = self.parameters
        particles, foresight = judged.particles, learned.foresight
        particles = self._resampler.resample(particles, parameters.particles, draw)
        is_seen = judged.track.state == "tracking"
        if not is_seen:
            particles, foresight = self._while_hidden.go_on(target, judged, particles, foresight)
        # Once lost, the target may be anywhere; how long ago that was adds nothing.
        hidden_for = min(judged.track.hidden_for, parameters.track.lost_after)
        covariance = self._measurer.covariance(target, measured, judged, hidden_for)
        estimate = _estimate(judged, measured.frame, measured.powers, covariance)
        return replace(
            target,
            foresight=foresight,
            particles=particles,
            templates=learned.templates,
            first_templates={**learned.templates, **target.first_templates},
            distraction=measured.distraction,
            track=judged.track,
            seen_box=estimate.box if is_seen else target.seen_box,
            hidden_frames=0 if is_seen else target.hidden_frames + 1,
            followed_frames=target.followed_frames + 1,
            randomness=Randomness.of(draw),
            estimate=estimate,
        )

    def _spread(self, motion: MotionModel, frame: Frame, draw: np.random.Generator) -> ParticleSet:
        """Particles around the box that a motion begins with."""
        states = motion.prior(self.parameters.particles, draw)
        return ParticleSet.uniform(motion.constrain(states, frame.size))

    def _motion(self, first_box: Box) -> MotionModel:
        motion = self.parameters.motion
        return MOTION_MODELS[motion.model](first_box, motion.of_model[""])

    def _foresight(self, motion: MotionModel) -> KalmanForesight | None:
        if self.parameters.proposal.method != "kalman":
            return None
        return cast(ForeseenMotion, motion).foresight()


def _estimate(
    judged: Judgment, frame: Frame, powers: Powers, covariance: NDArray[np.float64]
) -> Estimate:
    judged.boxes.setflags(write=False)
    covariance.setflags(write=False)
    return Estimate(
        box=as_box(judged.box),
        state=judged.track.state,
        confidence=judged.confidence,
        covariance=covariance,
        particles=judged.particles.states,
        particle_boxes=judged.boxes,
        weights=judged.particles.weights,
        effective_sample_size=judged.particles.effective_sample_size,
        powers=FrozenPowers(powers),
        background=frame.background,
    )
