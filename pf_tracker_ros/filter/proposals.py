"""Proposals: where the particles of the next frame are drawn, and what that does to their weights.

A particle drawn from a proposal q instead of the transition prior p has its weight multiplied by
p(x_k | x_{k-1}) / q(x_k | x_{k-1}); its expectations stay those of the transition prior, whatever
the proposal, as long as q is positive where p is.

Source: Zhang Bo, section 3.3; Doucet, Godsill, Andrieu 2000, "On sequential Monte Carlo sampling
methods for Bayesian filtering", section II.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.parameters import declared

_LOG_TWO_PI = math.log(2.0 * math.pi)
# The transition prior keeps a part, so that no weight is multiplied by more than 1 / that part.
LARGEST_SHARE = 0.95


class Transition(Protocol):
    """A transition prior x_k = f(x_{k-1}) + u with Gaussian noise u, its axes independent."""

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, D) f(x) of (N, D) states."""

    def spread(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, D), or what broadcasts to it: standard deviations of the noise from (N, D) states.

        A column is noisy for all states or for none. One without noise, such as a position kept
        from the frame before, follows f whatever the proposal.
        """


class Proposed(NamedTuple):
    """Particles drawn from a proposal.

    Attributes:
        states: (N, D), row i drawn for particle i.
        log_ratio: (N,) log p(x_k | x_{k-1}) - log q(x_k | x_{k-1}), to be added to the log weights.
    """

    states: NDArray[np.float64]
    log_ratio: NDArray[np.float64]


@dataclass(frozen=True)
class ProposalParameters:
    """Where the particles are drawn."""

    kalman_share: float = declared(
        0.0,
        "Share of the particles drawn around a Kalman filter's prediction, the rest from the "
        "transition prior; 0 switches the Kalman filter off. Needs the motion model affine or "
        "second_order_autoregressive.",
        minimum=0.0,
        maximum=LARGEST_SHARE,
        read_only=True,
    )


def propose_from_transition(
    states: NDArray[np.float64], transition: Transition, generator: np.random.Generator
) -> Proposed:
    """Draw from the transition prior, the proposal of the bootstrap filter; all ratios are 1.

    Args:
        states: (N, D) particles of the last frame.
        transition: How they go on.
        generator: Source of randomness.
    """
    noise = generator.standard_normal(states.shape)
    noise *= transition.spread(states)
    noise += transition.mean(states)
    return Proposed(noise, np.zeros(len(states)))


def propose_from_prediction(
    states: NDArray[np.float64],
    transition: Transition,
    prediction: Gaussian,
    share: float,
    generator: np.random.Generator,
) -> Proposed:
    """Draw from a mixture of a Kalman filter's prediction and the transition prior.

    q(x_k | x_{k-1}) = share N(x_k; prediction) + (1 - share) p(x_k | x_{k-1}); the ratio takes the
    whole mixture, whichever part a particle was drawn from, so it never exceeds 1 / (1 - share).

    Args:
        states: (N, D) particles of the last frame.
        transition: How they go on.
        prediction: Of the D-dimensional state in this frame.
        share: Probability, 0 to `LARGEST_SHARE`, that a particle is drawn from the prediction.
        generator: Source of randomness.

    Raises:
        ValueError: The share is out of range, or the prediction has another number of columns or a
            covariance that is not positive definite.
    """
    if not 0.0 <= share <= LARGEST_SHARE:
        raise ValueError(f"share of the prediction is {share}; allowed: 0 to {LARGEST_SHARE}")
    if len(prediction.mean) != states.shape[1]:
        raise ValueError(
            f"prediction has {len(prediction.mean)} columns; expected {states.shape[1]}"
        )
    if share == 0.0:
        return propose_from_transition(states, transition, generator)
    mean = transition.mean(states)
    spread = np.broadcast_to(transition.spread(states), states.shape)
    noisy = spread[0] > 0.0
    spread = spread[:, noisy]
    drawn = mean[:, noisy] + spread * generator.standard_normal(spread.shape)
    ahead = generator.random(len(states)) < share
    center = prediction.marginal(noisy)
    drawn[ahead] = center.draw(int(ahead.sum()), generator)

    offsets = (drawn - mean[:, noisy]) / spread
    log_prior = -(0.5 * np.square(offsets) + np.log(spread) + 0.5 * _LOG_TWO_PI).sum(axis=1)
    log_mixture = np.logaddexp(
        math.log(share) + center.log_density(drawn), math.log1p(-share) + log_prior
    )
    proposed = mean
    proposed[:, noisy] = drawn
    return Proposed(proposed, log_prior - log_mixture)
