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
    Distraction,
    Powers,
    Strengths,
    Templates,
    smooth_distraction,
)
from pf_tracker_ros.filter import ParticleSet, ProposalParameters, SearchableMotion
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.tracking.judgment import Judgment
from pf_tracker_ros.tracking.prediction import Prediction
from pf_tracker_ros.tracking.search import Search, covariance_about, mean_around
from pf_tracker_ros.tracking.target import Target

# What is known of a frame beside its pixels: log likelihoods of boxes, in their one shape.
Evidence = Callable[[BoxesByAxis], NDArray[np.float64]]
# What looks so much like the target, 0 to 1, is a rival: the mean of what the cues say, multiplied.
_ALIKE_ABOVE = 0.5


class Expectation(NamedTuple):
    """A target in a frame that has not been looked at.

    Attributes:
        target: After the last frame.
        frame: The next one.
        interval: Seconds between them.
        prediction: The particles, as drawn for it.
        draw: Source of randomness from there on.
        boxes: (N, 4) of the particles, pixels.
        region: What of the frame is looked at.
        search: Where the target is looked for; None without a search.
    """

    target: Target
    frame: Frame
    interval: float
    prediction: Prediction
    draw: np.random.Generator
    boxes: NDArray[np.float64]
    region: Region
    search: Search | None = None


class Weighed(NamedTuple):
    """The particles of a frame, weighed by it.

    Attributes:
        expected: What was looked at.
        predicted: The particles before they were weighed.
        particles: The same, weighed.
        boxes: (N, 4) of the particles, pixels.
        powers: Of the cues, in this frame.
        likeliest: Number of the particle with the highest posterior density.
        strengths: Name of a searchable cue to its (M,) strengths at the places of the search.
        searched: (M,) log likelihoods of these places; empty without a search.
    """

    expected: Expectation
    predicted: ParticleSet
    particles: ParticleSet
    boxes: NDArray[np.float64]
    powers: Powers
    likeliest: int = 0
    strengths: Strengths = MappingProxyType({})
    searched: NDArray[np.float64] = np.empty(0)


class Measurement(NamedTuple):
    """The particles of a frame, weighed by it, and what it shows at their estimate.

    Attributes:
        frame: That was looked at.
        predicted: The particles before they were weighed.
        particles: The same, weighed.
        boxes: (N, 4) of the particles, pixels.
        box: (4,) that they stand for, pixels.
        powers: Of the cues, in this frame.
        seen: What each cue observes at the box.
        match: How well that fits the templates.
        distraction: How much of what is around has looked like the target lately.
        search: Where the target was looked for; None without a search.
        runner_up: (4,) likeliest box beside the target's, pixels; None without a search.
        rival: (4,) box of what looks like the target beside it; None where nothing does, and
            without a search.
        unsearched: The particles where the motion alone took them; None without a search.
    """

    frame: Frame
    predicted: ParticleSet
    particles: ParticleSet
    boxes: NDArray[np.float64]
    box: NDArray[np.float64]
    powers: Powers
    seen: Templates
    match: Match
    distraction: Distraction
    search: Search | None = None
    runner_up: NDArray[np.float64] | None = None
    rival: NDArray[np.float64] | None = None
    unsearched: ParticleSet | None = None

    @property
    def spread(self) -> float:
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

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> tuple[Templates, Distraction]:
        """Templates of what is in a (4,) box, and how much of what is around looks like it."""
        return self.templates(frame, box), {}

    def templates(self, frame: Frame, box: NDArray[np.float64]) -> Templates:
        """Templates of what is in a (4,) box."""
        return self._fusion.learn(self._region(frame, box[None], box), box)

    def expect(
        self,
        target: Target,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        draw: np.random.Generator,
        *,
        looks_for_size: bool = True,
    ) -> Expectation:
        """What of a frame is to be looked at.

        Args:
            target: After the last frame.
            frame: The next one.
            interval: Seconds between them.
            prediction: For it.
            draw: Source of randomness from there on.
            looks_for_size: See `Region`.
        """
        boxes = target.motion.boxes(prediction.particles.states)
        last_box = np.asarray(target.estimate.box)
        region = self._region(frame, boxes, last_box, looks_for_size=looks_for_size)
        return Expectation(target, frame, interval, prediction, draw, boxes, region)

    def weigh(self, expected: Expectation, evidence: Evidence | None = None) -> Weighed:
        """The particles, weighed by the frame.

        Args:
            expected: Of the frame at hand.
            evidence: One more factor of the likelihood; None where there is none.

        Source: Li et al. 2007, equation (8); Zhang et al. 2015, equation (10).
        """
        predicted, boxes = expected.prediction.particles, expected.boxes
        powers = self._fusion.powers
        likelihood = self._log_likelihood(expected, boxes, powers, evidence)
        return Weighed(expected, predicted, predicted.reweight(likelihood), boxes, powers)

    def _log_likelihood(
        self,
        expected: Expectation,
        boxes: NDArray[np.float64],
        powers: Powers,
        evidence: Evidence | None,
    ) -> NDArray[np.float64]:
        """(N,) of (N, 4) boxes: that of the cues, and the evidence."""
        templates = expected.target.templates
        likelihood = self._fusion.log_likelihood(expected.region, boxes, templates, powers)
        return likelihood + evidence(BoxesByAxis(*boxes.T)) if evidence else likelihood

    def estimate(self, weighed: Weighed) -> Measurement:
        """The box that the particles stand for, and what the frame shows there.

        Source: Li et al. 2007, section 2.2; Zhang et al. 2015, equation (5).
        """
        box = weighed.expected.target.motion.boxes(weighed.particles.mean[None])[0]
        return self._measured(weighed, box)

    def _measured(self, weighed: Weighed, box: NDArray[np.float64]) -> Measurement:
        expected = weighed.expected
        seen = self._fusion.observe(expected.region, box)
        match = self._fusion.match(seen, expected.target.templates)
        return Measurement(
            frame=expected.frame,
            predicted=weighed.predicted,
            particles=weighed.particles,
            boxes=weighed.boxes,
            box=box,
            powers=weighed.powers,
            seen=seen,
            match=match,
            distraction={},
        )

    def covariance(
        self, target: Target, measured: Measurement, judged: Judgment, hidden_for: float
    ) -> NDArray[np.float64]:
        """(2, 2) covariance of the target's center, px^2.

        Args:
            target: After the last frame.
            measured: In this frame.
            judged: What is told of the target.
            hidden_for: Seconds without a sight of it that count.
        """
        return judged.particles.covariance[:2, :2]

    def log_likelihoods(
        self, target: Target, frame: Frame, boxes: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Name of each cue to its (N,) log likelihoods of (N, 4) boxes of the target's size."""
        place = np.asarray(target.estimate.box)
        region = self._region(frame, boxes, place, place)
        return self._fusion.log_likelihoods(region, boxes, target.templates)

    def _region(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        place: NDArray[np.float64] | None = None,
        *,
        looks_for_size: bool = True,
    ) -> Region:
        """What covers (N, 4) boxes, reduced as the size of a (4,) box asks for."""
        if place is None and self._fusion.looks_in_one_size:
            place = boxes.mean(axis=0)
        target_size = math.sqrt(target_box[2] * target_box[3])
        reduction = math.ceil(target_size / self._working_size)
        return Region(
            frame,
            boxes,
            reduction,
            self._fusion.reach,
            place=place,
            looks_for_size=looks_for_size,
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

    def learn(self, frame: Frame, box: NDArray[np.float64]) -> tuple[Templates, Distraction]:
        """See `Measurer.learn`."""
        search, region = self.look(frame, box)
        templates = self._fusion.learn(region, box)
        found = self._fusion.strengths_on_grid(region, search.grid, templates)
        own = self._fusion.strengths(region, box[None], templates)
        return templates, search.distraction(box, own, found)

    def look(self, frame: Frame, place: NDArray[np.float64]) -> tuple[Search, Region]:
        """A search around a (4,) box, and the region that it reads."""
        search = Search(place, self._parameters, frame.size)
        return search, self._region(frame, search.cover(place[None]), place, place)

    def expect(
        self,
        target: Target,
        frame: Frame,
        interval: float,
        prediction: Prediction,
        draw: np.random.Generator,
        *,
        looks_for_size: bool = True,
    ) -> Expectation:
        """See `Measurer.expect`."""
        if not self._fusion.searches(target.templates):
            # Cues that were just chosen have no template yet, and can't search in this frame.
            return super().expect(
                target, frame, interval, prediction, draw, looks_for_size=looks_for_size
            )
        boxes = target.motion.boxes(prediction.particles.states)
        search = Search(prediction.particles.weights @ boxes, self._parameters, frame.size)
        last_box = np.asarray(target.estimate.box)
        region = self._region(
            frame, search.cover(boxes), last_box, search.place, looks_for_size=looks_for_size
        )
        return Expectation(target, frame, interval, prediction, draw, boxes, region, search)

    def weigh(self, expected: Expectation, evidence: Evidence | None = None) -> Weighed:
        """See `Measurer.weigh`; the weights carry p / q."""
        target, search, region = expected.target, expected.search, expected.region
        if search is None:
            return super().weigh(expected, evidence)
        motion, prediction = cast(SearchableMotion, target.motion), expected.prediction
        powers = self._fusion.adapt(target.distraction, self._adaptation)
        strengths = self._fusion.strengths_on_grid(region, search.grid, target.templates)
        centers = motion.center_prior(target.particles.states, prediction.interval)
        searched = self._fusion.search(region, search.grid, strengths, target.templates, powers)
        if evidence:
            searched += evidence(search.grid.by_axis).ravel()
        predicted, log_prior = search.propose(
            prediction.particles, motion, centers, searched, expected.draw
        )
        boxes = motion.boxes(predicted.states)
        likelihood = self._log_likelihood(expected, boxes, powers, evidence)
        likeliest = int(np.argmax(log_prior + likelihood))
        particles = predicted.reweight(likelihood)
        return Weighed(
            expected, predicted, particles, boxes, powers, likeliest, strengths, searched
        )

    def estimate(self, weighed: Weighed) -> Measurement:
        """See `Measurer.estimate`; the mean is that of the likeliest mode."""
        expected, strengths = weighed.expected, weighed.strengths
        target, search = expected.target, expected.search
        if search is None:
            return super().estimate(weighed)
        mean = mean_around(weighed.particles, weighed.boxes, weighed.likeliest)
        box = target.motion.boxes(mean[None])[0]
        own = self._fusion.strengths(expected.region, box[None], target.templates)
        now = search.distraction(box, own, strengths)
        rival = None
        # The most that single cues find bounds what all of them can find at one place.
        if math.prod(now.values()) >= _ALIKE_ABOVE ** len(now):
            rival = search.rival(box, own, strengths, _ALIKE_ABOVE)
        return self._measured(weighed, box)._replace(
            distraction=smooth_distraction(target.distraction, now),
            search=search,
            runner_up=search.runner_up(box, weighed.searched),
            rival=rival,
            unsearched=expected.prediction.particles,
        )

    def covariance(
        self, target: Target, measured: Measurement, judged: Judgment, hidden_for: float
    ) -> NDArray[np.float64]:
        """See `Measurer.covariance`: about the box, anywhere else with what confidence lacks."""
        if measured.search is None:
            return super().covariance(target, measured, judged, hidden_for)
        center = judged.box[:2] + judged.box[2:] / 2
        within_mode = covariance_about(judged.particles, center)
        is_hidden = judged.track.state != "tracking"
        walk = cast(SearchableMotion, target.motion).walk(hidden_for) if is_hidden else None
        return measured.search.covariance(within_mode, judged.confidence, walk)
