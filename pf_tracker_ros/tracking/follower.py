"""One frame of tracking: predict, weigh, estimate, judge, learn, resample."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
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
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.redetection import window_centers
from pf_tracker_ros.tracking.search import Search, covariance_about, mean_around
from pf_tracker_ros.tracking.target import Target
from pf_tracker_ros.tracking.track_state import Track

# Seconds after which a prediction covers all that can be; numbers would overflow in the end.
_LONGEST_PREDICTION = 60.0


class _Frame(NamedTuple):
    """A frame at hand, and what its measurement takes beside the target.

    Attributes:
        image: (H, W, 3) BGR or (H, W).
        interval: Seconds to predict over.
        foreground: As in `FrameMaps`.
        powers: Of the cues.
        generator: Source of randomness.
    """

    image: NDArray[np.uint8]
    interval: float
    foreground: tuple[NDArray[np.uint8], int] | None
    powers: Powers
    generator: np.random.Generator


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


class _Found(NamedTuple):
    """What was found elsewhere in the image.

    Attributes:
        box: (4,) x, y, width, height in pixels.
        confidence: That it is the target, 0 to 1.
    """

    box: NDArray[np.float64]
    confidence: float


class Follower:
    """Follows a target from image to image, as the parameters say.

    Args:
        parameters: Every tunable.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self.parameters = parameters
        self._fusion = build_fusion(parameters)
        check_proposal(parameters, self._fusion)
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
        particles = ParticleSet.uniform(motion.prior(self.parameters.particles, generator))
        particles = particles.moved(motion.constrained(particles.states, _size(image)))
        boxes = np.array([first_box])
        background = self._background(image, first_box, generator)
        seen = _foreground(background, image, first_box)
        search = self._search(boxes[0], image)
        maps = self._maps(image, boxes, boxes[0], seen, search)
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
            glances=0,
            estimate=_estimate(
                first_box,
                Track(),
                1.0,
                particles,
                motion.boxes(particles.states),
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
        predicted, foresight = self._proposed(target, ahead, _size(image), generator)
        frame = _Frame(
            image,
            ahead,
            _foreground(target.background, image, target.estimate.box),
            self._fusion.adapted(target.distraction, parameters.fusion.adaptation),
            generator,
        )
        boxes = motion.boxes(predicted.states)
        search = self._search(predicted.weights @ boxes, image)
        last_box = np.asarray(target.estimate.box)
        maps = self._maps(image, boxes, last_box, frame.foreground, search)
        weighed = self._weighed(target, frame, predicted, maps, search)
        weighted, boxes = weighed.particles, weighed.boxes
        box = motion.boxes(weighed.mean[None])
        distracted = self._distracted(target, maps, box, weighed)

        seen = self._fusion.observe(maps, box[0])
        match = self._fusion.match(seen, target.templates)
        confidence = match.similarity
        track = target.track.after(confidence, interval, parameters.track)
        templates = target.templates
        if track.state == "tracking" or not parameters.track.coast:
            trusted = math.exp(match.log_likelihood) > parameters.template.update_above
            if confidence >= parameters.template.confident_above:
                templates = self._fusion.updated(templates, seen, trusted, parameters.template.keep)
            if foresight:
                foresight = foresight.corrected(weighted.mean, weighted.covariance)
        else:
            # What is at the box is not the target: its likelihoods would pull the particles to
            # whatever hides it. The motion model alone carries them on.
            weighted = weighed.predicted
            box = motion.boxes(weighted.mean[None])

        particles = self._resampled(weighted, boxes, generator)
        if track.state == "lost" and parameters.track.coast:
            # Going on from where the target was lost, every frame searches that region anew. Going
            # on from here, the cloud and its cost would grow without end.
            particles, foresight = target.particles, target.foresight

        glances = 0
        if track.state == "lost" and search:
            glances = target.glances + parameters.redetection.windows
            found = self._redetected(target, frame)
            if found:
                box, confidence, track = found.box[None], found.confidence, Track()
                particles = self._around(found.box, frame)
                weighted, boxes = particles, motion.boxes(particles.states)

        x, y, width, height = (float(value) for value in box[0])
        told = (x, y, width, height)
        return replace(
            target,
            particles=particles,
            foresight=foresight,
            templates=templates,
            distraction=distracted,
            track=track,
            seen_box=told if track.state == "tracking" else target.seen_box,
            glances=glances,
            estimate=_estimate(
                told,
                track,
                confidence,
                weighted,
                boxes,
                powers=frame.powers,
                covariance=self._covariance(weighted, box[0], search, track, confidence),
                background=target.background,
            ),
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
        frame: _Frame,
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

    def _distracted(
        self, target: Target, maps: FrameMaps, box: NDArray[np.float64], weighed: _Weighed
    ) -> Distraction:
        """How much of what is around the (1, 4) box looks like the target."""
        if weighed.search is None:
            return target.distraction
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

    def _redetected(self, target: Target, frame: _Frame) -> _Found | None:
        """The target, if it is in one of the windows of the image whose turn it is.

        A window is searched by the templates from before the target was lost, at the size that the
        target had then. What is likeliest there is looked at again with the window around it, and
        taken for the target if that look is confident.
        """
        parameters = self.parameters
        half_size = np.array(target.seen_box[2:]) / 2
        side = 2 * parameters.proposal.search_window * math.sqrt(half_size[0] * half_size[1])
        windows = parameters.redetection.windows
        best = _Found(np.empty(4), parameters.redetection.accept_above)
        for center in window_centers(_size(frame.image), side, target.glances, windows):
            found = self._glance(target, frame, np.hstack([center - half_size, 2 * half_size]))
            if found.confidence > parameters.track.occluded_below:
                found = self._glance(target, frame, found.box)
                best = max(best, found, key=lambda look: look.confidence)
        return best if best.confidence > parameters.redetection.accept_above else None

    def _glance(self, target: Target, frame: _Frame, place: NDArray[np.float64]) -> _Found:
        """What is likeliest in a window around a (4,) box, and how likely it is the target."""
        search = Search(place, self.parameters.proposal, _size(frame.image))
        maps = self._maps(frame.image, place[None], place, frame.foreground, search)
        strengths = self._fusion.strengths(maps, search.boxes, target.templates)
        if not strengths:
            return _Found(place, 0.0)
        likelihood = self._fusion.searched(strengths, target.templates, frame.powers)
        box = search.boxes[int(np.argmax(likelihood))]
        seen = self._fusion.observe(maps, box)
        return _Found(box, self._fusion.match(seen, target.templates).similarity)

    def _around(self, box: NDArray[np.float64], frame: _Frame) -> ParticleSet:
        """Particles of a target that was just found in a (4,) box."""
        x, y, width, height = (float(value) for value in box)
        motion = self._motion((x, y, width, height))
        states = motion.prior(self.parameters.particles, frame.generator)
        return ParticleSet.uniform(motion.constrained(states, _size(frame.image)))

    def _covariance(
        self,
        particles: ParticleSet,
        box: NDArray[np.float64],
        search: Search | None,
        track: Track,
        confidence: float,
    ) -> NDArray[np.float64]:
        if search is None:
            return particles.covariance[:2, :2]
        # Once lost, the target may be anywhere; how long ago that was adds nothing.
        hidden_for = min(track.hidden_for, self.parameters.track.lost_after)
        return search.covariance(
            covariance_about(particles, box[:2] + box[2:] / 2),
            confidence,
            None if track.state == "tracking" else hidden_for,
            self.parameters.motion.position_noise,
        )

    def _motion(self, first_box: Box) -> MotionModel:
        return MOTION_MODELS[self.parameters.motion.model](first_box, self.parameters.motion)

    def _search(self, place: NDArray[np.float64], image: NDArray[np.uint8]) -> Search | None:
        proposal = self.parameters.proposal
        return Search(place, proposal, _size(image)) if proposal.search_share > 0.0 else None

    def _foresight(self, motion: MotionModel) -> KalmanForesight | None:
        return motion.foresight() if self.parameters.proposal.kalman_share > 0.0 else None

    def _background(
        self, image: NDArray[np.uint8], box: Box, generator: np.random.Generator
    ) -> BackgroundModel | None:
        parameters = self.parameters
        if parameters.moving_foreground.power > 0.0 or parameters.color_histogram.foreground_only:
            return BackgroundModel(image, parameters.background, generator, box)
        return None

    def _maps(
        self,
        image: NDArray[np.uint8],
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        foreground: tuple[NDArray[np.uint8], int] | None = None,
        search: Search | None = None,
    ) -> FrameMaps:
        target_size = math.sqrt(target_box[2] * target_box[3])
        reduction = math.ceil(target_size / self.parameters.working_size)
        place = search.place if search else None
        if place is None and self._fusion.looks_in_one_size:
            place = boxes.mean(axis=0)
        return FrameMaps(
            image,
            search.covered(boxes) if search else boxes,
            reduction,
            self._fusion.reach,
            foreground=foreground,
            place=place,
        )


def _foreground(
    background: BackgroundModel | None, image: NDArray[np.uint8], box: Box
) -> tuple[NDArray[np.uint8], int] | None:
    """`FrameMaps.foreground` of the next frame, which the model learns; None if it says nothing."""
    if background is None:
        return None
    mask = background.update(image, box)
    return None if background.state.name == "off" else (mask, background.reduction)


def _size(image: NDArray[np.uint8]) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def _estimate(
    box: Box,
    track: Track,
    confidence: float,
    particles: ParticleSet,
    particle_boxes: NDArray[np.float64],
    *,
    powers: Powers,
    covariance: NDArray[np.float64],
    background: BackgroundModel | None,
) -> Estimate:
    particle_boxes.setflags(write=False)
    covariance.setflags(write=False)
    return Estimate(
        box=box,
        state=track.state,
        confidence=confidence,
        covariance=covariance,
        particles=particles.states,
        particle_boxes=particle_boxes,
        weights=particles.weights,
        effective_sample_size=particles.effective_sample_size,
        powers=MappingProxyType(dict(powers)),
        background=background.state if background else None,
    )
