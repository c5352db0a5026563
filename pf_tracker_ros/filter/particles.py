"""Weighted particles, which represent the posterior density of a state.

1. N states x_i with weights w_i, which sum to 1, represent p(x_k | z_1, ..., z_k).
2. A motion model moves the states; the weights stay (`ParticleSet.move`).
3. A measurement multiplies each weight by its likelihood p(z_k | x_i), then the weights are
   normalized (`reweight`).
4. The weighted mean is the estimate with the least mean square error (`mean`).
5. 1 / sum of w_i^2 is the effective sample size, the number of equally weighted particles of the
   same accuracy. When it is small, the particles are resampled (`resample`).

`GeneratorState` makes the random draws repeatable: it is the state of a generator as a value.

Source: Zhang et al. 2015, equations (5), (6), (10) and (11).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISeedSequence
from numpy.typing import ArrayLike, DTypeLike, NDArray


class _AnySeed(ISeedSequence):
    """Seed of a generator whose state is then replaced; hashing a real seed takes far longer."""

    def generate_state(
        self, n_words: int, dtype: DTypeLike = np.uint32
    ) -> NDArray[np.uint32 | np.uint64]:
        return np.zeros(n_words, dtype)


_ANY_SEED = _AnySeed()


@dataclass(frozen=True, eq=False)
class GeneratorState:
    """Immutable state of a random generator.

    Attributes:
        state: State of a PCG64 bit generator, in NumPy's form.
    """

    state: Mapping[str, Any]

    @classmethod
    def of(cls, generator: np.random.Generator) -> GeneratorState:
        """The present state of a generator made by `numpy.random.default_rng`."""
        return cls(generator.bit_generator.state)

    def generator(self) -> np.random.Generator:
        """A new generator in this state; every call returns the same random sequence."""
        bits = np.random.PCG64(_ANY_SEED)  # type: ignore[arg-type]
        bits.state = self.state  # type: ignore[assignment]
        return np.random.Generator(bits)


def _read_only(values: ArrayLike) -> NDArray[np.float64]:
    """A read-only copy."""
    return _frozen(np.array(values, dtype=np.float64))


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Makes the array read-only and returns it; there must be no other reference to it."""
    array.setflags(write=False)
    return array


def _normalized(log_weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) log weights, normalized in place and read-only; see `_frozen`."""
    largest = float(log_weights.max())
    if math.isnan(largest):
        log_weights[np.isnan(log_weights)] = -np.inf
        largest = float(log_weights.max())
    if largest == math.inf:
        log_weights = np.where(log_weights == math.inf, 0.0, -np.inf)
        largest = 0.0
    if math.isfinite(largest):
        log_weights -= largest
        log_weights -= math.log(np.exp(log_weights).sum())
    else:
        log_weights[:] = -math.log(len(log_weights))
    return _frozen(log_weights)


@dataclass(frozen=True, eq=False)
class ParticleSet:
    """N weighted samples of a D-dimensional state; every operation returns a new set.

    Weights are stored as logarithms, because a product of many small likelihoods underflows. They
    are normalized at construction: NaN counts as a weight of 0, infinite log weights share all of
    the weight, and if no weight is positive, all become equal.

    Attributes:
        states: (N, D) read-only.
        log_weights: (N,) read-only; their exponentials sum to 1.

    Raises:
        ValueError: `states` is not (N, D) with N >= 1, or `log_weights` is not (N,).
    """

    states: NDArray[np.float64]
    log_weights: NDArray[np.float64]

    def __post_init__(self) -> None:
        states = _read_only(self.states)
        log_weights = np.array(self.log_weights, dtype=np.float64)
        if states.ndim != 2 or len(states) == 0:
            raise ValueError(f"states have shape {states.shape}; expected (N, D) with N >= 1")
        if log_weights.shape != (len(states),):
            raise ValueError(
                f"log weights have shape {log_weights.shape}; expected ({len(states)},)"
            )
        object.__setattr__(self, "states", states)
        object.__setattr__(self, "log_weights", _normalized(log_weights))

    @classmethod
    def uniform(cls, states: ArrayLike) -> ParticleSet:
        """Particles of equal weight at the given (N, D) states."""
        states = np.asarray(states, dtype=np.float64)
        return cls(states, np.zeros(len(states)))

    @classmethod
    def _of(cls, states: NDArray[np.float64], log_weights: NDArray[np.float64]) -> ParticleSet:
        """Particles of read-only states and read-only, normalized log weights."""
        particles = object.__new__(cls)
        object.__setattr__(particles, "states", states)
        object.__setattr__(particles, "log_weights", log_weights)
        return particles

    def __len__(self) -> int:
        return len(self.states)

    @cached_property
    def weights(self) -> NDArray[np.float64]:
        """(N,) normalized weights, summing to 1; read-only."""
        return _frozen(np.exp(self.log_weights))

    @cached_property
    def effective_sample_size(self) -> float:
        """1 / sum of squared weights: 1 (one particle has all weight) to N (equal weights).

        Source: Zhang et al. 2015, equation (6).
        """
        return float(1.0 / (self.weights @ self.weights))

    @cached_property
    def mean(self) -> NDArray[np.float64]:
        """(D,) weighted mean of the states, the minimum mean square error (MMSE) estimate.

        Source: Zhang et al. 2015, equation (5); Li et al. 2007, section 1.
        """
        return _frozen(self.weights @ self.states)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """(D, D) weighted covariance of the states about their mean."""
        offsets = self.states - self.mean
        return _frozen((offsets * self.weights[:, None]).T @ offsets)

    def move(self, states: ArrayLike) -> ParticleSet:
        """The same weights at other (N, D) states.

        Raises:
            ValueError: The states are not (N, D).
        """
        moved = np.asarray(states)
        if moved.ndim != 2 or len(moved) != len(self):
            raise ValueError(f"states have shape {moved.shape}; expected ({len(self)}, D)")
        return self._of(_read_only(moved), self.log_weights)

    def reweight(self, log_likelihood: ArrayLike) -> ParticleSet:
        """Multiply every weight by a likelihood, given as (N,) logarithms, and normalize.

        If no weight would stay positive, the weights are left unchanged.

        Source: Zhang et al. 2015, equations (10) and (11).

        Raises:
            ValueError: The likelihoods are not (N,).
        """
        likelihood = np.asarray(log_likelihood, dtype=np.float64)
        if likelihood.shape != self.log_weights.shape:
            raise ValueError(
                f"log likelihoods have shape {likelihood.shape}; expected ({len(self)},)"
            )
        log_weights = self.log_weights + likelihood
        if not (log_weights > -np.inf).any():
            return self
        return self._of(self.states, _normalized(log_weights))

    def resample(self, indices: NDArray[np.intp]) -> ParticleSet:
        """Copies of the particles at `indices`, with equal weights."""
        log_weights = np.full(len(indices), -math.log(len(indices)))
        return self._of(_frozen(self.states[indices]), _frozen(log_weights))
