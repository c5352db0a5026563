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
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.parameters import declared

_LOG_TWO_PI = math.log(2.0 * math.pi)
# The transition prior keeps a part, so that no weight is multiplied by more than 1 / that part.
LARGEST_SHARE = 0.95
# Probability that the target is anywhere in what is searched, and not where its motion takes it.
_JUMP_PROBABILITY = 0.1


class Transition(Protocol):
    """A transition prior x_k = f(x_{k-1}) + u with Gaussian noise u, its axes independent."""

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, D) f(x) of (N, D) states."""

    def std(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, D), or what broadcasts to it: standard deviations of the noise from (N, D) states.

        A column is noisy for all states or for none. One without noise, such as a position kept
        from the frame before, follows f whatever the proposal.
        """


class ProposedStates(NamedTuple):
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

    method: str = declared(
        "transition",
        "Where the particles are drawn: transition from the motion model alone, kalman a share "
        "around a Kalman filter's prediction (models affine and second_order_autoregressive), "
        "search a share where the cues that can search find the target likely (models "
        "constant_velocity and constant_velocity_and_size).",
        choices=("transition", "kalman", "search"),
        read_only=True,
    )
    share: float = declared(
        0.5,
        "Share of the particles drawn by the method, the rest from the transition prior.",
        minimum=0.01,
        maximum=LARGEST_SHARE,
        only_with=("method", "kalman", "search"),
    )
    window: float = declared(
        3.6,
        "Side of the square around the prediction that is searched.",
        unit="box sizes",
        minimum=1.0,
        maximum=8.0,
        only_with=("method", "search"),
    )


def propose_from_transition(
    states: NDArray[np.float64], transition: Transition, generator: np.random.Generator
) -> ProposedStates:
    """Draw from the transition prior, the proposal of the bootstrap filter; all ratios are 1.

    Args:
        states: (N, D) particles of the last frame.
        transition: How they go on.
        generator: Source of randomness.
    """
    noise = generator.standard_normal(states.shape)
    noise *= transition.std(states)
    noise += transition.mean(states)
    return ProposedStates(noise, np.zeros(len(states)))


def propose_from_prediction(
    states: NDArray[np.float64],
    transition: Transition,
    prediction: Gaussian,
    share: float,
    generator: np.random.Generator,
) -> ProposedStates:
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
    std = np.broadcast_to(transition.std(states), states.shape)
    noisy = std[0] > 0.0
    std = std[:, noisy]
    drawn = mean[:, noisy] + std * generator.standard_normal(std.shape)
    ahead = generator.random(len(states)) < share
    center = prediction.marginal(noisy)
    drawn[ahead] = center.draw(int(ahead.sum()), generator)

    log_prior = _log_density(drawn, mean[:, noisy], std)
    log_mixture = np.logaddexp(
        math.log(share) + center.log_density(drawn), math.log1p(-share) + log_prior
    )
    proposed = mean
    proposed[:, noisy] = drawn
    return ProposedStates(proposed, log_prior - log_mixture)


@dataclass(frozen=True)
class SearchGrid:
    """Square cells that the target's center may lie in.

    Attributes:
        center: (2,) of the middle of the grid, pixels.
        spacing: Side of a cell, pixels.
        count: Cells along each side.
    """

    center: NDArray[np.float64]
    spacing: float
    count: int

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """(2, count) x of each column's center, y of each row's."""
        offsets = (np.arange(self.count) - (self.count - 1) / 2) * self.spacing
        return offsets + self.center[:, None]

    @cached_property
    def centers(self) -> NDArray[np.float64]:
        """(count^2, 2) centers of the cells, row by row."""
        x, y = self.axes
        return np.column_stack([np.tile(x, self.count), np.repeat(y, self.count)])

    def cells_of(self, places: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """(N,) number of the cell that each of (N, 2) places is in, and whether it is in any.

        The number of a place that is in none is 0.
        """
        offsets = (places - self.center) / self.spacing + self.count / 2
        column, row = np.floor(offsets.T).astype(np.intp)
        inside = (column >= 0) & (column < self.count) & (row >= 0) & (row < self.count)
        return np.where(inside, row * self.count + column, 0), inside


class GridDensity:
    """A density that is even within each cell of a grid, and 0 outside.

    Args:
        grid: Its M cells.
        log_likelihood: (M,) of the cells; any constant may be added to all.
    """

    def __init__(self, grid: SearchGrid, log_likelihood: NDArray[np.float64]) -> None:
        shares = np.exp(log_likelihood - log_likelihood.max())
        self.grid = grid
        self._shares = shares / shares.sum()

    def draw(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """(count, 2) places, pixels."""
        cells = np.searchsorted(np.cumsum(self._shares), generator.random(count) * (1.0 - 1e-12))
        within = (generator.random((count, 2)) - 0.5) * self.grid.spacing
        rows, columns = np.divmod(np.minimum(cells, len(self._shares) - 1), self.grid.count)
        x, y = self.grid.axes
        return np.column_stack([x[columns], y[rows]]) + within

    def log_densities(
        self, places: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N,) log densities, per px^2, at (N, 2) places: this, and of being anywhere in the grid.

        Outside of the grid both are minus infinity.
        """
        cells, inside = self.grid.cells_of(places)
        with np.errstate(divide="ignore"):
            own = np.log(np.where(inside, self._shares[cells], 0.0) / self.grid.spacing**2)
        anywhere = -2.0 * math.log(self.grid.spacing * self.grid.count)
        return own, np.where(inside, anywhere, -np.inf)


class CenterPrior(NamedTuple):
    """Where a motion model takes the center of each particle: a round Gaussian.

    Attributes:
        mean: (N, 2), pixels.
        std: (N, 1) or (1,) standard deviation along each axis, pixels, above 0.
    """

    mean: NDArray[np.float64]
    std: NDArray[np.float64]


class ProposedCenters(NamedTuple):
    """Particles drawn from a search.

    Attributes:
        centers: (N, 2), row i drawn for particle i.
        log_prior: (N,) log p(center | particle i of the last frame).
        log_ratio: (N,) log p - log q, to be added to the log weights.
    """

    centers: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    log_ratio: NDArray[np.float64]


def propose_from_search(
    drawn: NDArray[np.float64],
    prior: CenterPrior,
    found: GridDensity,
    share: float,
    generator: np.random.Generator,
) -> ProposedCenters:
    """Move a share of the particles to where a search finds the target likely.

    The center is believed to be N(mean, spread^2) or, with the probability of a jump, anywhere in
    the grid. A share s of the particles is drawn from the likelihood G over the grid:
    q = s G(x) + (1 - s) N(x; mean, spread^2). As in `propose_from_prediction` the ratio takes the
    whole mixture.

    Args:
        drawn: (N, 2) centers drawn from the prior, pixels.
        prior: Mean and spread.
        found: The likelihood over the grid, as a density.
        share: Probability, above 0 up to `LARGEST_SHARE`, that a particle is drawn from it.
        generator: Source of randomness.

    Source: as in this module; Okuma et al. 2004, "A boosted particle filter: multitarget detection
    and tracking", section 4 (a proposal from detections).
    """
    count = len(drawn)
    jump = _JUMP_PROBABILITY
    searched = generator.random(count) < share
    centers = np.where(searched[:, None], found.draw(count, generator), drawn)

    log_motion = _log_density(centers, prior.mean, prior.std)
    log_found, log_anywhere = found.log_densities(centers)
    log_prior = np.logaddexp(math.log1p(-jump) + log_motion, math.log(jump) + log_anywhere)
    log_mixture = np.logaddexp(math.log(share) + log_found, math.log1p(-share) + log_motion)
    return ProposedCenters(centers, log_prior, log_prior - log_mixture)


def _log_density(
    values: NDArray[np.float64], mean: NDArray[np.float64], std: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,) log density of a Gaussian with independent axes.

    Args:
        values: (N, D).
        mean: (N, D).
        std: Standard deviations, (N, D) or of a shape that stands for it.
    """
    offsets = (values - mean) / std
    return -(0.5 * np.square(offsets) + np.log(std) + 0.5 * _LOG_TWO_PI).sum(axis=1)
