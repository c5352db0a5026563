"""The tracker: one target, followed from image to image by a fused-cue particle filter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.cues import FrameMaps
from pf_tracker_ros.cues.fusion import (
    Distraction,
    Powers,
    Strengths,
    Templates,
    smoothed_distraction,
)
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    Box,
    KalmanForesight,
    MotionModel,
    ParticleSet,
    build_resampler,
)
from pf_tracker_ros.parameters import ParameterError, build, declarations, flatten
from pf_tracker_ros.tracking.all_cues import build_fusion
from pf_tracker_ros.tracking.checks import check_proposal
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.image import (
    adapted_range,
    check_box,
    check_image,
    check_interval,
    gray_range,
    to_8_bit,
)
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.search import Search, covariance_about, mean_around
from pf_tracker_ros.tracking.track_state import Track

# Seconds after which a prediction covers all that can be; numbers would overflow in the end.
_LONGEST_PREDICTION = 60.0


@dataclass(frozen=True)
class _Target:
    """All that is known of the target; a frame replaces it whole or not at all.

    Only the background model learns in place: copying it would cost more than the frame.
    """

    first_box: Box
    image_shape: tuple[int, ...]
    gray_range: tuple[float, float] | None
    motion: MotionModel
    foresight: KalmanForesight | None
    background: BackgroundModel | None
    particles: ParticleSet
    templates: Templates
    distraction: Distraction
    track: Track
    estimate: Estimate


class Tracker:
    """Tracks one target.

    The same frames, box, parameters and seed give the same estimates, to the bit, on one machine.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness; each `start` begins the sequence anew.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        self._seed = seed
        self._target: _Target | None = None
        self._generator = np.random.default_rng(seed)
        self._configure(parameters)

    @classmethod
    def from_preset(
        cls, preset: str, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> Tracker:
        """A tracker with the parameters of a preset.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value, over the preset's.

        Raises:
            ParameterError: No such preset or parameter, or a value that is not allowed.
        """
        values = preset_parameters(preset) | dict(parameters or {})
        return cls(build(TrackerParameters, values), seed)

    @property
    def started(self) -> bool:
        """Whether there is a target to track."""
        return self._target is not None

    @property
    def estimate(self) -> Estimate | None:
        """The last estimate, None before `start`."""
        return self._target.estimate if self._target else None

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Change parameters, all or none, without losing the target.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, values contradict each other, or a
                read-only parameter would change while there is a target.
        """
        before = self.parameters
        parameters = build(TrackerParameters, before | dict(values))
        if self.started:
            known = declarations(TrackerParameters)
            for name, value in flatten(parameters).items():
                if known[name].read_only and value != before[name]:
                    raise ParameterError(
                        f"parameter '{name}' can't change while a target is tracked; stop first"
                    )
        self._configure(parameters)

    def start(self, image: NDArray[np.generic], box: ArrayLike) -> Estimate:
        """Take a new target.

        Args:
            image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
            box: (x, y, width, height) of the target in pixels, (x, y) the top-left corner counted
                from 0; its center inside the image.

        Returns:
            The estimate for this first frame: the box itself, with confidence 1.

        Raises:
            ValueError: The image or the box is not usable; a target from before is then kept.
        """
        check_image(image)
        first_box = check_box(box, _size(image))
        span = gray_range(image)
        generator = np.random.default_rng(self._seed)
        motion = _motion_model(first_box, self._parameters)
        particles = ParticleSet.uniform(motion.prior(self._parameters.particles, generator))
        particles = particles.moved(motion.constrained(particles.states, _size(image)))
        boxes = np.array([first_box])
        first_image = to_8_bit(image, span)
        background = self._background(first_image, first_box, generator)
        seen = _foreground(background, first_image, first_box)
        search = self._search(boxes[0], first_image)
        maps = self._maps(first_image, boxes, boxes[0], seen, search)
        templates = self._fusion.learn(maps, boxes[0])
        distracted: Distraction = {}
        if search:
            own, strengths = (
                self._fusion.strengths(maps, at, templates) for at in (boxes, search.boxes)
            )
            distracted = search.distraction(boxes[0], own, strengths)
        self._generator = generator
        self._target = _Target(
            first_box=first_box,
            image_shape=image.shape,
            gray_range=span,
            motion=motion,
            foresight=self._foresight(motion),
            background=background,
            particles=particles,
            templates=templates,
            distraction=distracted,
            track=Track(),
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
        return self._target.estimate

    def stop(self) -> None:
        """Forget the target."""
        self._target = None

    def update(self, image: NDArray[np.generic], dt: float | None = None) -> Estimate:
        """Follow the target into the next frame.

        Args:
            image: As for `start`, of the same size and kind.
            dt: Seconds since the last frame; None means the nominal interval.

        Returns:
            What is now known of the target.

        Raises:
            RuntimeError: There is no target; call `start` first.
            ValueError: The image or `dt` is not usable; the last good state is kept.
        """
        target = self._target
        if target is None:
            raise RuntimeError("no target: call start(image, box) first")
        check_image(image)
        if image.shape != target.image_shape or (image.dtype == np.uint16) != bool(
            target.gray_range
        ):
            raise ValueError(
                f"image is {image.shape} {image.dtype}, but the target was started on "
                f"{target.image_shape}; start again to change the image's size or kind"
            )
        interval = self._parameters.nominal_interval if dt is None else check_interval(dt)
        span = adapted_range(target.gray_range, image, interval)
        target = replace(target, gray_range=span)
        self._target = self._updated(target, to_8_bit(image, span), interval)
        return self._target.estimate

    def _updated(self, target: _Target, image: NDArray[np.uint8], interval: float) -> _Target:
        """Predict, weigh, estimate, judge, learn, resample: one frame."""
        parameters, motion = self._parameters, target.motion
        ahead = min(interval, _LONGEST_PREDICTION)
        predicted, foresight = self._proposed(target, ahead, _size(image))

        powers = self._fusion.adapted(target.distraction, parameters.fusion.adaptation)
        boxes = motion.boxes(predicted.states)
        foreground = _foreground(target.background, image, target.estimate.box)
        search = self._search(predicted.weights @ boxes, image)
        maps = self._maps(image, boxes, np.asarray(target.estimate.box), foreground, search)
        log_prior = None
        strengths: Strengths = {}
        centers = motion.center_prior(target.particles.states, ahead) if search else None
        if search and centers:
            strengths = self._fusion.strengths(maps, search.boxes, target.templates)
        # A cue that was just switched on has no template yet and can't search in this frame.
        if search and centers and strengths:
            found = self._fusion.searched(strengths, target.templates, powers)
            predicted, log_prior = search.proposed(
                predicted, motion, centers, found, self._generator
            )
            boxes = motion.boxes(predicted.states)
        likelihood = self._fusion.log_likelihood(maps, boxes, target.templates, powers)
        weighted = predicted.reweighted(likelihood)
        mean = weighted.mean
        if log_prior is not None:
            mean = mean_around(weighted, boxes, int(np.argmax(log_prior + likelihood)))
        box = motion.boxes(mean[None])
        distracted = target.distraction
        if search:
            own = self._fusion.strengths(maps, box, target.templates)
            now = search.distraction(box[0], own, strengths)
            distracted = smoothed_distraction(distracted, now, parameters.fusion.adaptation_rate)
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
            weighted = predicted
            box = motion.boxes(weighted.mean[None])

        particles = self._resampler.resample(weighted, parameters.particles, self._generator)
        if track.state == "lost" and parameters.track.coast:
            # Going on from where the target was lost, every frame searches that region anew. Going
            # on from here, the cloud and its cost would grow without end.
            particles, foresight = target.particles, target.foresight

        x, y, width, height = (float(value) for value in box[0])
        return replace(
            target,
            particles=particles,
            foresight=foresight,
            templates=templates,
            distraction=distracted,
            track=track,
            estimate=_estimate(
                (x, y, width, height),
                track,
                confidence,
                weighted,
                boxes,
                powers=powers,
                covariance=self._covariance(weighted, box[0], search, track, confidence),
                background=target.background,
            ),
        )

    def _proposed(
        self, target: _Target, interval: float, image_size: tuple[int, int]
    ) -> tuple[ParticleSet, KalmanForesight | None]:
        """The particles drawn for this frame, and the Kalman filter's prediction if there is one.

        Source: Zhang Bo, section 3.3: the weights of particles drawn around it carry p / q.
        """
        particles, motion = target.particles, target.motion
        if target.foresight is None:
            states = motion.predict(particles.states, interval, self._generator)
            return particles.moved(motion.constrained(states, image_size)), None
        foresight = target.foresight.predicted(interval)
        # Out of sight, nothing corrects the filter, and its prediction is no better than the prior.
        hidden = target.track.state != "tracking"
        share = 0.0 if hidden else self._parameters.proposal.kalman_share
        proposed = foresight.proposed(particles.states, interval, share, self._generator)
        moved = particles.moved(motion.constrained(proposed.states, image_size))
        return moved.reweighted(proposed.log_ratio), foresight

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
        hidden_for = min(track.hidden_for, self._parameters.track.lost_after)
        return search.covariance(
            covariance_about(particles, box[:2] + box[2:] / 2),
            confidence,
            None if track.state == "tracking" else hidden_for,
            self._parameters.motion.position_noise,
        )

    def _search(self, place: NDArray[np.float64], image: NDArray[np.uint8]) -> Search | None:
        proposal = self._parameters.proposal
        return Search(place, proposal, _size(image)) if proposal.search_share > 0.0 else None

    def _foresight(self, motion: MotionModel) -> KalmanForesight | None:
        return motion.foresight() if self._parameters.proposal.kalman_share > 0.0 else None

    def _background(
        self, image: NDArray[np.uint8], box: Box, generator: np.random.Generator
    ) -> BackgroundModel | None:
        parameters = self._parameters
        if parameters.moving_foreground.power > 0.0 or parameters.color_histogram.foreground_only:
            return BackgroundModel(image, parameters.background, generator, box)
        return None

    def _configure(self, parameters: TrackerParameters) -> None:
        fusion = build_fusion(parameters)
        check_proposal(parameters, fusion)
        self._fusion = fusion
        self._resampler = build_resampler(parameters.resampling)
        self._parameters = parameters
        if self._target:
            motion = _motion_model(self._target.first_box, parameters)
            foresight = self._foresight(motion)
            if foresight and self._target.foresight:
                foresight = replace(foresight, belief=self._target.foresight.belief)
            self._target = replace(self._target, motion=motion, foresight=foresight)

    def _maps(
        self,
        image: NDArray[np.uint8],
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        foreground: tuple[NDArray[np.uint8], int] | None = None,
        search: Search | None = None,
    ) -> FrameMaps:
        target_size = math.sqrt(target_box[2] * target_box[3])
        reduction = math.ceil(target_size / self._parameters.working_size)
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


def _motion_model(first_box: Box, parameters: TrackerParameters) -> MotionModel:
    return MOTION_MODELS[parameters.motion.model](first_box, parameters.motion)


def _foreground(
    background: BackgroundModel | None, image: NDArray[np.uint8], box: Box
) -> tuple[NDArray[np.uint8], int] | None:
    """`FrameMaps.foreground` of the next frame, which the model learns; None if it says nothing."""
    if background is None:
        return None
    mask = background.update(image, box)
    return None if background.state.name == "off" else (mask, background.reduction)


def _size(image: NDArray[np.generic]) -> tuple[int, int]:
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
