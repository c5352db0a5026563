"""The weighted particles that stand for the posterior distribution; random numbers as a value."""

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
    """To make a generator of, whose state is then replaced: a true seed would take far longer."""

    def generate_state(
        self, n_words: int, dtype: DTypeLike = np.uint32
    ) -> NDArray[np.uint32 | np.uint64]:
        return np.zeros(n_words, dtype)


_ANY_SEED = _AnySeed()


@dataclass(frozen=True, eq=False)
class GeneratorState:
    """Where a source of random numbers stands; what is drawn from it leaves it as it is.

    Attributes:
        state: Of a PCG64 bit generator, as NumPy describes it.
    """

    state: Mapping[str, Any]

    @classmethod
    def of(cls, generator: np.random.Generator) -> GeneratorState:
        """Where a generator, as `numpy.random.default_rng` makes it, stands."""
        return cls(generator.bit_generator.state)

    def generator(self) -> np.random.Generator:
        """A generator that goes on from here, the same numbers at every call."""
        bits = np.random.PCG64(_ANY_SEED)  # type: ignore[arg-type]
        bits.state = self.state  # type: ignore[assignment]
        return np.random.Generator(bits)


def _read_only(values: ArrayLike) -> NDArray[np.float64]:
    """A copy that nobody can write to."""
    return _frozen(np.array(values, dtype=np.float64))


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """An array that nobody else holds, as one that nobody can write to."""
    array.setflags(write=False)
    return array


def _normalized(log_weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) log weights that nobody else holds, made to sum to 1 as weights, and read-only."""
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
    """N weighted samples of a D-dimensional state; every operation returns another set.

    Weights are kept as logarithms, normalized at construction: a product of many small likelihoods
    would underflow. A log weight that is NaN counts as minus infinity, a weight of zero; those that
    are infinite share all of the weight. Where no particle has a positive weight, all get the same,
    since nothing then speaks for any of them.

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
        """Particles of states and normalized log weights that are known to be read-only."""
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
        """1 / sum of squared weights, from 1 (one particle has it all) to N (all alike).

        Source: Zhang et al. 2015, equation (6).
        """
        return float(1.0 / (self.weights @ self.weights))

    @cached_property
    def mean(self) -> NDArray[np.float64]:
        """(D,) weighted mean of the states, the minimum mean square error estimate.

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
            ValueError: The states are not as many.
        """
        moved = np.asarray(states)
        if moved.ndim != 2 or len(moved) != len(self):
            raise ValueError(f"states have shape {moved.shape}; expected ({len(self)}, D)")
        return self._of(_read_only(moved), self.log_weights)

    def reweight(self, log_likelihood: ArrayLike) -> ParticleSet:
        """Multiply every weight by a likelihood, given as N logarithms, and normalize.

        A likelihood that leaves no particle with a positive weight says nothing about the state:
        the weights then stay as they were.

        Source: Zhang et al. 2015, equations (10) and (11).

        Raises:
            ValueError: The likelihoods are not as many.
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
        """Particles of equal weight, copies of the ones that `indices` names."""
        log_weights = np.full(len(indices), -math.log(len(indices)))
        return self._of(_frozen(self.states[indices]), _frozen(log_weights))
