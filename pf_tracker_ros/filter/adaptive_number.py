"""As many particles as the spread of the belief asks for.

A belief that lies in one place is told by few particles, one that is all over the image takes many.
The number is that with which the Kullback-Leibler distance between the particles and the belief, as
told by a histogram over the bins that the belief lies in, stays below a bound in 99 of 100 cases.

Source: Fox 2003, "Adapting the sample size in particle filters through KLD-sampling", section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.filter.resampling import Resampler
from pf_tracker_ros.parameters import declared

# Quantile of the standard normal distribution that 99 of 100 cases are below (z).
_QUANTILE = 2.3263478740408408


@dataclass(frozen=True)
class AdaptiveNumberParameters:
    """The number of particles, adapted to the spread of the belief."""

    error: float = declared(
        0.0,
        "Bound of the Kullback-Leibler distance between the particles and the belief that they "
        "stand for (epsilon); a smaller one takes more particles. 0 keeps their number as it is.",
        minimum=0.0,
        maximum=10.0,
    )
    fewest: int = declared(
        50,
        "Fewest particles, however narrow the belief; 'particles' is the most.",
        minimum=1,
        maximum=100_000,
    )
    bin_size: float = declared(
        0.1,
        "Side of the bins of position and of the logarithm of the size that the belief is told by.",
        unit="box sizes",
        minimum=0.001,
        maximum=10.0,
    )


def particles_needed(bins: NDArray[np.intp], error: float) -> NDArray[np.float64]:
    """(K,) numbers of particles that beliefs over (K,) numbers of bins take.

    Source: Fox 2003, section 3: the chi-square quantile over 2 epsilon, with the approximation of
    Wilson and Hilferty.

    Args:
        bins: Numbers of bins (k) that hold any of the belief, at least 1.
        error: Bound of the Kullback-Leibler distance (epsilon), above 0.
    """
    freedom = np.maximum(bins - 1, 1).astype(np.float64)
    spread = 2.0 / (9.0 * freedom)
    quantile = freedom * (1.0 - spread + np.sqrt(spread) * _QUANTILE) ** 3
    with np.errstate(over="ignore"):
        # An error near 0 asks for more particles than there are numbers: infinity.
        needed: NDArray[np.float64] = np.where(bins > 1, quantile / (2.0 * error), 1.0)
    return needed


@dataclass(frozen=True)
class AdaptiveResampler:
    """Draws as many particles as the bins that they fall in need.

    One draw tells the number, another of that number are the particles: so they keep what the
    scheme promises, its variance and the best particle.

    Source: Fox 2003, section 3.

    Attributes:
        resampler: The scheme that draws.
        parameters: Bound, fewest and bins.
    """

    resampler: Resampler
    parameters: AdaptiveNumberParameters

    def resample(
        self,
        particles: ParticleSet,
        boxes: NDArray[np.float64],
        most: int,
        generator: np.random.Generator,
    ) -> ParticleSet:
        """The particles for the next frame, all of equal weight.

        Args:
            particles: The N weighted particles of this frame.
            boxes: (N, 4) of them, pixels.
            most: How many the next frame has at most.
            generator: Source of randomness.
        """
        weights = particles.weights
        drawn = generator.permutation(self.resampler.indices(weights, most, generator))
        bins = _bins(boxes, self.parameters.bin_size)[drawn]
        first = np.unique(bins, axis=0, return_index=True)[1]
        opened = np.cumsum(np.isin(np.arange(most), first), dtype=np.intp)
        needed = particles_needed(opened, self.parameters.error)
        enough = np.arange(1, most + 1) >= np.maximum(needed, min(self.parameters.fewest, most))
        count = int(np.argmax(enough)) + 1 if enough.any() else most
        return particles.resampled(self.resampler.indices(weights, count, generator))


def _bins(boxes: NDArray[np.float64], bin_size: float) -> NDArray[np.float64]:
    """(N, 3) whole numbers of the bins of position and size that (N, 4) boxes fall in."""
    sizes = np.sqrt(boxes[:, 2] * boxes[:, 3])
    side = bin_size * float(np.exp(np.log(sizes).mean()))
    centers = boxes[:, :2] + boxes[:, 2:] / 2
    return np.floor(np.column_stack([centers / side, np.log(sizes) / bin_size]))
