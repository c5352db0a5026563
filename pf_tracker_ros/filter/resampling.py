"""Resampling: likely particles are copied, unlikely ones dropped.

After some frames, most of the weight lies on few particles (degeneracy). Resampling then draws the
particles anew, in proportion to their weights:

1. Compute the effective sample size. If it is at least `threshold * N`, stop.
2. Choose `count` positions in [0, 1). The schemes differ here.
3. Look each position up in the cumulative weights; this gives the index of a particle.
4. Copy these particles and make their weights equal.

All schemes but the elitist one are unbiased: particle i is drawn `count * weight_i` times on
average. The systematic scheme varies the number of copies least. All take O(N + count log N)
time; multinomial and residual also sort random numbers. Residual first draws the whole part of
`count * weight_i`.

Source: Douc, Cappe, Moulines 2005, "Comparison of resampling schemes for particle filtering".
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
            count: Number of particles to draw.
            generator: Source of randomness.

        Returns:
            (count,) indices into `weights`.
        """


RESAMPLERS = Registry[Resampler]("resampling scheme", group="pf_tracker_ros.resamplers")

_LARGEST_POSITION = np.nextafter(1.0, 0.0)


def _inverse_cdf(weights: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices at which the cumulative weights pass the sorted `positions` in [0, 1)."""
    cumulative = np.cumsum(weights)
    # Rounding must not put a position beyond the last sum, nor select a particle of weight 0.
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
        return _inverse_cdf(weights, np.sort(generator.random(count)))


@RESAMPLERS.register("stratified")
class StratifiedResampler:
    """One uniform draw in each of `count` equal strata of the cumulative weights."""

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        return _inverse_cdf(weights, (np.arange(count) + generator.random(count)) / count)


@RESAMPLERS.register("systematic")
class SystematicResampler:
    """One uniform draw, repeated at equal distances over the cumulative weights.

    Particle i comes out floor(count * weight_i) or ceil(count * weight_i) times.
    """

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        return _inverse_cdf(weights, (np.arange(count) + generator.random()) / count)


@RESAMPLERS.register("residual")
class ResidualResampler:
    """The whole part of `count * weight_i` without chance, the rest by independent draws."""

    def indices(
        self, weights: NDArray[np.float64], count: int, generator: np.random.Generator
    ) -> NDArray[np.intp]:
        """See `Resampler.indices`."""
        expected = count * weights
        # Rounding can leave a product just below a whole number.
        copies = np.floor(expected + 1e-9).astype(np.intp)
        certain = np.repeat(np.arange(len(weights)), copies)
        rest = count - len(certain)
        if rest <= 0:
            return certain[:count]
        residual = np.maximum(expected - copies, 0.0)
        positions = np.sort(generator.random(rest))
        return np.concatenate([certain, _inverse_cdf(residual / residual.sum(), positions)])


@dataclass(frozen=True)
class ElitistResampler:
    """Draws by another scheme and always keeps the particle of the largest weight.

    If the draw misses that particle, it replaces the first one drawn. This is biased, and meant
    for few particles and sharp likelihoods.

    Source: Zhang et al. 2015, section 3.3, step 3.

    Attributes:
        resampler: The resampling scheme.
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
def _multinomial_elitist() -> Resampler:
    return ElitistResampler(MultinomialResampler())


@dataclass(frozen=True)
class ResamplingParameters:
    """When and how the particles are resampled."""

    scheme: str = declared(
        "systematic",
        "Resampling scheme: systematic varies the number of copies least; "
        "multinomial_elitist always keeps the particle of the largest weight, for few particles.",
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
    """Resamples when the effective sample size is small.

    Resampling particles of nearly equal weights would only reduce their diversity.

    Attributes:
        resampler: The resampling scheme.
        threshold: Resample below this share of the number of particles, 0 to 1.
    """

    resampler: Resampler
    threshold: float

    def resample(
        self, particles: ParticleSet, count: int, generator: np.random.Generator
    ) -> ParticleSet:
        """Resample if needed.

        Args:
            particles: Weighted particles of this frame.
            count: Number of particles in the next frame; if it changes, they are resampled.
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
