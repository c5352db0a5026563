"""Resampling schemes: which particles go on, and how often each.

Every scheme but those that keep the best particle is unbiased: particle i is drawn
`count * weight_i` times on average. They differ in the variance of the draws, smallest for the
systematic one. All take O(N + count log N) time, and the multinomial and the residual one sort
random numbers first.

Reference: Douc, Cappe, Moulines 2005, "Comparison of resampling schemes for particle filtering".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.parameters import declared, parts
from pf_tracker_ros.registry import Registry


class Resampler(Protocol):
    """Draws particles in proportion to their weights."""

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """Draw particles.

        Args:
            weights: (N,) normalized weights.
            count: How many to draw.
            generator: Source of randomness.

        Returns:
            (count,) indices into `weights`.
        """


RESAMPLERS = Registry[Resampler]("resampling scheme", group="pf_tracker_ros.resamplers")

_LARGEST_POSITION = np.nextafter(1.0, 0.0)


def _invert(weights: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices at which the cumulative weights pass the sorted `positions` in [0, 1)."""
    cumulative = np.cumsum(weights)
    # Rounding must neither leave a position beyond the last sum nor pick a particle of no weight.
    cumulative /= cumulative[-1]
    return cumulative.searchsorted(np.minimum(positions, _LARGEST_POSITION), side="right")


@RESAMPLERS.register("multinomial")
class MultinomialResampler:
    """Independent draws: cumulative weights against sorted uniform numbers.

    Source: Zhang et al. 2015, section 2 (resampling); Zhang Bo, step 5.
    """

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        return _invert(weights, np.sort(generator.random(count)))


@RESAMPLERS.register("stratified")
class StratifiedResampler:
    """One uniform draw in each of `count` equal strata of the cumulative weights."""

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        return _invert(weights, (np.arange(count) + generator.random(count)) / count)


@RESAMPLERS.register("systematic")
class SystematicResampler:
    """One uniform draw, repeated at equal distances over the cumulative weights.

    Particle i comes out floor(count * weight_i) or ceil(count * weight_i) times.
    """

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        return _invert(weights, (np.arange(count) + generator.random()) / count)


@RESAMPLERS.register("residual")
class ResidualResampler:
    """The whole part of count * weight_i for certain, the rest by independent draws."""

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        expected = count * weights
        # A product that rounding left a hair below a whole number is that number.
        copies = np.floor(expected + 1e-9).astype(np.intp)
        certain = np.repeat(np.arange(len(weights)), copies)
        rest = count - len(certain)
        if rest <= 0:
            return certain[:count]
        residual = np.maximum(expected - copies, 0.0)
        positions = np.sort(generator.random(rest))
        return np.concatenate([certain, _invert(residual / residual.sum(), positions)])


@dataclass(frozen=True)
class ElitistResampler:
    """Draws by another scheme, and keeps the particle of the largest weight.

    Chance may pass over the best particle of a few; if it does, the first draw is given to it.
    That costs the draws their unbiasedness, so it is for few particles and sharp likelihoods.

    Source: Zhang et al. 2015, section 3.3, step 3.

    Attributes:
        resampler: The scheme that draws.
    """

    resampler: Resampler

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        indices = self.resampler.indices(weights, count, generator)
        best = int(np.argmax(weights))
        if best not in indices:
            indices[0] = best
        return indices


@RESAMPLERS.register("multinomial_elitist")
def _multinomial_keeping_best() -> Resampler:
    return ElitistResampler(MultinomialResampler())


@dataclass(frozen=True)
class ResamplingParameters:
    """When and how the particles are resampled."""

    scheme: str = declared(
        "systematic",
        "Resampling scheme: systematic has the least variance; multinomial_elitist lets the "
        "particle of the largest weight always go on, for few particles.",
        choices=RESAMPLERS,
    )
    of_schemes: dict[str, Any] = parts("scheme", RESAMPLERS)
    threshold: float = declared(
        0.8,
        "Resample when the effective sample size falls below this share of the particles; "
        "1 resamples every frame, 0 never.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True)
class EffectiveSampleSizeResampler:
    """Resamples only when the effective sample size asks for it.

    Resampling while the weights are still even would throw away particles for nothing.

    Attributes:
        resampler: The scheme that draws.
        threshold: Share of the number of particles, 0 to 1, below which it draws.
    """

    resampler: Resampler
    threshold: float

    def resample(
        self, particles: ParticleSet, count: int, generator: np.random.Generator
    ) -> ParticleSet:
        """The particles for the next frame.

        Args:
            particles: The weighted particles of this frame.
            count: How many particles the next frame is to have; a change of number resamples.
            generator: Source of randomness.

        Returns:
            `count` resampled particles of equal weight, or `particles` itself.
        """
        enough = particles.effective_sample_size >= self.threshold * len(particles)
        if enough and self.threshold < 1.0 and count == len(particles):
            return particles
        return particles.resample(self.resampler.indices(particles.weights, count, generator))


def build_resampler(parameters: ResamplingParameters) -> EffectiveSampleSizeResampler:
    """The resampler that the parameters describe."""
    scheme = RESAMPLERS.make(parameters.scheme, parameters.of_schemes[parameters.scheme])
    return EffectiveSampleSizeResampler(scheme, parameters.threshold)
