"""One frame of tracking: predict, weigh, estimate, judge, learn, resample."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.cues import FrameMaps
from pf_tracker_ros.cues.fusion import (
    Distraction,
    Powers,
    Strengths,
    smoothed_distraction,
)
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    AdaptiveResampler,
    Box,
    KalmanForesight,
    MotionModel,
    ParticleSet,
    build_resampler,
    build_scheme,
)
from pf_tracker_ros.tracking.all_cues import build_fusion
from pf_tracker_ros.tracking.checks import check_proposal
from pf_tracker_ros.tracking.estimate import Estimate, FrozenPowers
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.redetection import Redetector
from pf_tracker_ros.tracking.search import Search, covariance_about, mean_around
from pf_tracker_ros.tracking.target import Target
from pf_tracker_ros.tracking.track_state import Track
from pf_tracker_ros.tracking.viewing import Frame, Viewer

# Seconds after which a prediction covers all that can be; numbers would overflow in the end.
_LONGEST_PREDICTION = 60.0


class _Weighed(NamedTuple):
    """The particles of a frame after its measurement.

    Attributes:
        particles: Weighted by the frame.
        predicted: The same before they were weighed.
        boxes: (N, 4) of the particles.
        mean: (D,) state that they stand for.
        search: Where the target was looked for; None without a search.
        strengths: What each cue found there.
    """

    particles: ParticleSet
    predicted: ParticleSet
    boxes: NDArray[np.float64]
    mean: NDArray[np.float64]
    search: Search | None
    strengths: Strengths


class _Judged(NamedTuple):
    """What a frame's measurement is worth.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: That the target is there, 0 to 1.
        track: What follows for the track.
        particles: Of this frame, as told with the box.
        boxes: (N, 4) of them, pixels.
    """

    box: NDArray[np.float64]
    confidence: float
    track: Track
    particles: ParticleSet
    boxes: NDArray[np.float64]


class Follower:
    """Follows a target from image to image, as the parameters say.

    Args:
        parameters: Every tunable.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        fusion = build_fusion(parameters)
        check_proposal(parameters, fusion)
        self._fusion = fusion
        self._viewer = Viewer(fusion, parameters.proposal, parameters.working_size)
        self._redetector = Redetector(
            self._viewer,
            fusion,
            parameters.redetection,
            side=parameters.proposal.search_window,
            doubtful_below=parameters.track.occluded_below,
        )
        self._resampler = build_resampler(parameters.resampling)
        adaptive = parameters.adaptive_number
        self._adaptive_resampler = (
            AdaptiveResampler(build_scheme(parameters.resampling), adaptive)
            if adaptive.error > 0.0
            else None
        )

    def begun(
        self, image: NDArray[np.uint8], first_box: Box, generator: np.random.Generator
    ) -> Target:
        """A target in the first image.

        Args:
            image: (H, W, 3) BGR or (H, W).
            first_box: Of the target.
            generator: Source of randomness.
        """
        motion = self._motion(first_box)
        image_size = image.shape[1], image.shape[0]
        particles = ParticleSet.uniform(motion.prior(self.parameters.particles, generator))
        particles = particles.moved(motion.constrained(particles.states, image_size))
        boxes = np.array([first_box])
        background = self._background(image, first_box, generator)
        seen = _foreground(background, image, first_box)
        frame = Frame(image, 0.0, seen, self._fusion.powers, generator)
        search = self._viewer.search(frame, boxes[0])
        maps = self._viewer.maps(frame, boxes, boxes[0], search)
        templates = self._fusion.learn(maps, boxes[0])
        distracted: Distraction = {}
        if search:
            own, strengths = (
                self._fusion.strengths(maps, at, templates) for at in (boxes, search.boxes)
            )
            distracted = search.distraction(boxes[0], own, strengths)
        return Target(
            first_box=first_box,
            motion=motion,
            foresight=self._foresight(motion),
            background=background,
            particles=particles,
            templates=templates,
            distraction=distracted,
            track=Track(),
            seen_box=first_box,
            hidden_frames=0,
            followed_frames=0,
            estimate=_estimate(
                _Judged(boxes[0], 1.0, Track(), particles, motion.boxes(particles.states)),
                powers=self._fusion.powers,
                covariance=particles.covariance[:2, :2],
                background=background,
            ),
        )

    def reconfigured(self, target: Target) -> Target:
        """A target that was followed with other parameters, to be followed with these."""
        motion = self._motion(target.first_box)
        foresight = self._foresight(motion)
        if foresight and target.foresight:
            foresight = replace(foresight, belief=target.foresight.belief)
        return replace(target, motion=motion, foresight=foresight)

    def followed(
        self,
        target: Target,
        image: NDArray[np.uint8],
        interval: float,
        generator: np.random.Generator,
    ) -> Target:
        """The target one image later.

        Args:
            target: After the last image.
            image: (H, W, 3) BGR or (H, W), as before.
            interval: Seconds since the last one.
            generator: Source of randomness.
        """
        parameters, motion = self.parameters, target.motion
        ahead = min(interval, _LONGEST_PREDICTION)
        # Before the background model, which draws from the same source of randomness.
        image_size = image.shape[1], image.shape[0]
        predicted, foresight = self._proposed(target, ahead, image_size, generator)
        frame = Frame(
            image,
            ahead,
            _foreground(target.background, image, target.estimate.box),
            self._fusion.adapted(target.distraction, parameters.fusion.adaptation),
            generator,
        )
        boxes = motion.boxes(predicted.states)
        search = self._viewer.search(frame, predicted.weights @ boxes)
        maps = self._viewer.maps(frame, boxes, np.asarray(target.estimate.box), search)
        weighed = self._weighed(target, frame, predicted, maps, search)
        box = motion.boxes(weighed.mean[None])[0]
        seen = self._fusion.observe(maps, box)
        match = self._fusion.match(seen, target.templates)
        confidence = parameters.track.confidence(target.estimate.confidence, match.similarity)
        track = target.track.after(confidence, match.similarity, interval, parameters.track)
        templates, particles = target.templates, weighed.particles
        if track.state == "tracking" or not parameters.track.coast:
            trusted = math.exp(match.log_likelihood) > parameters.template.update_above
            if match.similarity >= parameters.template.confidence_asked(target.followed_frames):
                templates = self._fusion.updated(templates, seen, trusted, parameters.template.keep)
            if foresight:
                foresight = foresight.corrected(particles.mean, particles.covariance)
        else:
            # What is at the box is not the target: its likelihoods would pull the particles to
            # whatever hides it. The motion model alone carries them on.
            particles = weighed.predicted
            box = motion.boxes(particles.mean[None])[0]
        judged = _Judged(box, confidence, track, particles, weighed.boxes)
        following = self._resampled(particles, weighed.boxes, generator)
        if track.state == "lost" and parameters.track.coast:
            # Going on from where the target was lost, every frame searches that region anew. Going
            # on from here, the cloud and its cost would grow without end.
            following, foresight = target.particles, target.foresight
        is_here = match.similarity > parameters.track.recovered_above
        if search and track.state != "tracking" and not is_here:
            found = self._redetector.found(target, frame, box, track.state == "lost")
            if found:
                following = self._around(found.box, frame)
                judged = _Judged(*found, Track(), following, motion.boxes(following.states))

        estimate = _estimate(
            judged,
            powers=frame.powers,
            covariance=self._covariance(judged, search),
            background=target.background,
        )
        is_tracking = judged.track.state == "tracking"
        return replace(
            target,
            particles=following,
            foresight=foresight,
            templates=templates,
            distraction=self._distracted(target, maps, weighed),
            track=judged.track,
            seen_box=estimate.box if is_tracking else target.seen_box,
            hidden_frames=0 if is_tracking else target.hidden_frames + 1,
            followed_frames=target.followed_frames + 1,
            estimate=estimate,
        )

    def _proposed(
        self,
        target: Target,
        interval: float,
        image_size: tuple[int, int],
        generator: np.random.Generator,
    ) -> tuple[ParticleSet, KalmanForesight | None]:
        """The particles drawn for this frame, and the Kalman filter's prediction if there is one.

        Source: Zhang Bo, section 3.3: the weights of particles drawn around it carry p / q.
        """
        particles, motion = target.particles, target.motion
        if target.foresight is None:
            states = motion.predict(particles.states, interval, generator)
            return particles.moved(motion.constrained(states, image_size)), None
        foresight = target.foresight.predicted(interval)
        # Out of sight, nothing corrects the filter, and its prediction is no better than the prior.
        hidden = target.track.state != "tracking"
        share = 0.0 if hidden else self.parameters.proposal.kalman_share
        proposed = foresight.proposed(particles.states, interval, share, generator)
        moved = particles.moved(motion.constrained(proposed.states, image_size))
        return moved.reweighted(proposed.log_ratio), foresight

    def _weighed(
        self,
        target: Target,
        frame: Frame,
        predicted: ParticleSet,
        maps: FrameMaps,
        search: Search | None,
    ) -> _Weighed:
        """The predicted particles, a share of them moved by the search, weighed by the cues."""
        motion, templates = target.motion, target.templates
        log_prior = None
        strengths: Strengths = {}
        centers = motion.center_prior(target.particles.states, frame.interval) if search else None
        if search and centers:
            strengths = self._fusion.strengths(maps, search.boxes, templates)
        # A cue that was just switched on has no template yet and can't search in this frame.
        if search and centers and strengths:
            found = self._fusion.searched(strengths, templates, frame.powers)
            predicted, log_prior = search.proposed(
                predicted, motion, centers, found, frame.generator
            )
        boxes = motion.boxes(predicted.states)
        likelihood = self._fusion.log_likelihood(maps, boxes, templates, frame.powers)
        weighted = predicted.reweighted(likelihood)
        mean = weighted.mean
        if log_prior is not None:
            mean = mean_around(weighted, boxes, int(np.argmax(log_prior + likelihood)))
        return _Weighed(weighted, predicted, boxes, mean, search, strengths)

    def _distracted(self, target: Target, maps: FrameMaps, weighed: _Weighed) -> Distraction:
        """How much of what is around the weighed mean looks like the target."""
        if weighed.search is None:
            return target.distraction
        box = target.motion.boxes(weighed.mean[None])
        own = self._fusion.strengths(maps, box, target.templates)
        now = weighed.search.distraction(box[0], own, weighed.strengths)
        return smoothed_distraction(target.distraction, now, self.parameters.fusion.adaptation_rate)

    def _resampled(
        self, weighted: ParticleSet, boxes: NDArray[np.float64], generator: np.random.Generator
    ) -> ParticleSet:
        count = self.parameters.particles
        if self._adaptive_resampler:
            return self._adaptive_resampler.resample(weighted, boxes, count, generator)
        return self._resampler.resample(weighted, count, generator)

    def _around(self, box: NDArray[np.float64], frame: Frame) -> ParticleSet:
        """Particles of a target that was just found in a (4,) box."""
        x, y, width, height = (float(value) for value in box)
        motion = self._motion((x, y, width, height))
        states = motion.prior(self.parameters.particles, frame.generator)
        return ParticleSet.uniform(motion.constrained(states, frame.size))

    def _covariance(self, judged: _Judged, search: Search | None) -> NDArray[np.float64]:
        particles, box, track = judged.particles, judged.box, judged.track
        if search is None:
            return particles.covariance[:2, :2]
        # Once lost, the target may be anywhere; how long ago that was adds nothing.
        hidden_for = min(track.hidden_for, self.parameters.track.lost_after)
        return search.covariance(
            covariance_about(particles, box[:2] + box[2:] / 2),
            judged.confidence,
            None if track.state == "tracking" else hidden_for,
            self.parameters.motion.position_noise,
        )

    def _motion(self, first_box: Box) -> MotionModel:
        return MOTION_MODELS[self.parameters.motion.model](first_box, self.parameters.motion)

    def _foresight(self, motion: MotionModel) -> KalmanForesight | None:
        return motion.foresight() if self.parameters.proposal.kalman_share > 0.0 else None

    def _background(
        self, image: NDArray[np.uint8], box: Box, generator: np.random.Generator
    ) -> BackgroundModel | None:
        parameters = self.parameters
        if parameters.moving_foreground.power > 0.0 or parameters.color_histogram.foreground_only:
            return BackgroundModel(image, parameters.background, generator, box)
        return None


def _foreground(
    background: BackgroundModel | None, image: NDArray[np.uint8], box: Box
) -> tuple[NDArray[np.uint8], int] | None:
    """`FrameMaps.foreground` of the next frame, which the model learns; None if it says nothing."""
    if background is None:
        return None
    mask = background.update(image, box)
    return None if background.state.name == "off" else (mask, background.reduction)


def _estimate(
    judged: _Judged,
    *,
    powers: Powers,
    covariance: NDArray[np.float64],
    background: BackgroundModel | None,
) -> Estimate:
    x, y, width, height = (float(value) for value in judged.box)
    judged.boxes.setflags(write=False)
    covariance.setflags(write=False)
    return Estimate(
        box=(x, y, width, height),
        state=judged.track.state,
        confidence=judged.confidence,
        covariance=covariance,
        particles=judged.particles.states,
        particle_boxes=judged.boxes,
        weights=judged.particles.weights,
        effective_sample_size=judged.particles.effective_sample_size,
        powers=FrozenPowers(powers),
        background=background.state if background else None,
    )
