"""Proposals: densities from which the particles of the next frame are drawn.

The bootstrap filter draws from the transition prior p(x_k | x_{k-1}). A proposal q that knows more
puts more particles where the target is (importance sampling):

1. Draw x_k from q(x_k | x_{k-1}).
2. Multiply its weight by p(x_k | x_{k-1}) / q(x_k | x_{k-1}).
3. The weighted particles then represent the same posterior, if q > 0 wherever p > 0.

Both proposals here are mixtures; `share` is the mixture weight.

- `propose_from_prediction`: q = share g + (1 - share) p, with a Kalman filter's prediction g. The
  ratio p / q is at most 1 / (1 - share).
- `propose_from_search`: q = share G + (1 - share) N, with the cues' likelihood G on a grid of
  positions and the motion model's Gaussian N. The prior p is N mixed with jumps to anywhere on the
  grid. It is no component of q, so p / q has no such bound.

Sources: Zhang Bo, section 3.3; Doucet, Godsill, Andrieu 2000, "On sequential Monte Carlo sampling
methods for Bayesian filtering", section II; Okuma et al. 2004, "A boosted particle filter:
multitarget detection and tracking", section 4 (a proposal from detections).
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
# The transition prior keeps at least 5 %, which bounds p / q for the Kalman proposal.
LARGEST_SHARE = 0.95
# Prior probability of a jump: the center is then uniform over the grid, whatever the motion model
# predicts.
_JUMP_PROBABILITY = 0.1


class Transition(Protocol):
    """A transition prior x_k = f(x_{k-1}) + u with Gaussian noise u of independent axes."""

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """f(x), (N, D), of (N, D) states."""

    def std(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviations of the noise, broadcastable to (N, D), of (N, D) states.

        A column has noise for all particles or for none. A column without noise, such as the
        position one step ago, is always f(x).
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
    """The proposal density of the particles."""

    method: str = declared(
        "transition",
        "Proposal density: transition draws all particles from the motion model, kalman a share "
        "around a Kalman filter's prediction (models affine and second_order_autoregressive), "
        "search a share from the likelihood on a grid (models constant_velocity and "
        "constant_velocity_and_size; needs a cue that can search).",
        choices=("transition", "kalman", "search"),
        read_only=True,
    )
    share: float = declared(
        0.5,
        "Share of the particles drawn by the method; the motion model draws the rest.",
        minimum=0.01,
        maximum=LARGEST_SHARE,
        only_with=("method", "kalman", "search"),
    )
    window: float = declared(
        3.6,
        "Side of the searched square around the prediction.",
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
        transition: Transition prior.
        generator: Source of randomness.
    """
    proposed = generator.standard_normal(states.shape)
    proposed *= transition.std(states)
    proposed += transition.mean(states)
    return ProposedStates(proposed, np.zeros(len(states)))


def propose_from_prediction(
    states: NDArray[np.float64],
    transition: Transition,
    prediction: Gaussian,
    share: float,
    generator: np.random.Generator,
) -> ProposedStates:
    """Draw from a mixture of a Kalman filter's prediction and the transition prior.

    q(x_k | x_{k-1}) = share N(x_k; prediction) + (1 - share) p(x_k | x_{k-1}). The ratio uses the
    whole mixture, for particles drawn from either part.

    Args:
        states: (N, D) particles of the last frame.
        transition: Transition prior.
        prediction: Predicted density of the D-dimensional state in this frame.
        share: Probability, 0 to `LARGEST_SHARE`, that a particle is drawn from the prediction.
        generator: Source of randomness.

    Raises:
        ValueError: The share is out of range, the prediction does not have D columns, or its
            covariance is not positive definite.
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
    from_prediction = generator.random(len(states)) < share
    marginal = prediction.marginal(noisy)
    drawn[from_prediction] = marginal.draw(int(from_prediction.sum()), generator)

    log_prior = _log_density(drawn, mean[:, noisy], std)
    log_mixture = np.logaddexp(
        math.log(share) + marginal.log_density(drawn), math.log1p(-share) + log_prior
    )
    proposed = mean
    proposed[:, noisy] = drawn
    return ProposedStates(proposed, log_prior - log_mixture)


@dataclass(frozen=True)
class SearchGrid:
    """A square grid of square cells for the target's center.

    Attributes:
        center: (2,) middle of the grid, pixels.
        spacing: Side of a cell, pixels.
        count: Cells along each side.
    """

    center: NDArray[np.float64]
    spacing: float
    count: int

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """(2, count) x of the columns' centers and y of the rows' centers."""
        offsets = (np.arange(self.count) - (self.count - 1) / 2) * self.spacing
        return offsets + self.center[:, None]

    @cached_property
    def centers(self) -> NDArray[np.float64]:
        """(count^2, 2) centers of the cells, row by row."""
        x, y = self.axes
        return np.column_stack([np.tile(x, self.count), np.repeat(y, self.count)])

    def cells_of(self, points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """(N,) indices of the cells that contain (N, 2) points, and (N,) which points are inside.

        The index of a point outside of the grid is 0.
        """
        offsets = (points - self.center) / self.spacing + self.count / 2
        column, row = np.floor(offsets.T).astype(np.intp)
        inside = (column >= 0) & (column < self.count) & (row >= 0) & (row < self.count)
        return np.where(inside, row * self.count + column, 0), inside


class GridDensity:
    """A density that is constant within each cell of a grid, and 0 outside.

    Args:
        grid: The grid of M cells.
        log_likelihood: (M,) log likelihoods of the cells, up to a common constant.
    """

    def __init__(self, grid: SearchGrid, log_likelihood: NDArray[np.float64]) -> None:
        likelihood = np.exp(log_likelihood - log_likelihood.max())
        self.grid = grid
        self._probabilities = likelihood / likelihood.sum()

    def draw(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """(count, 2) random points, pixels."""
        cumulative = np.cumsum(self._probabilities)
        cells = np.searchsorted(cumulative, generator.random(count) * (1.0 - 1e-12))
        within = (generator.random((count, 2)) - 0.5) * self.grid.spacing
        rows, columns = np.divmod(np.minimum(cells, len(cumulative) - 1), self.grid.count)
        x, y = self.grid.axes
        return np.column_stack([x[columns], y[rows]]) + within

    def log_densities(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N,) log densities at (N, 2) points, per px^2, of this and of the uniform density.

        The uniform density covers the grid. Outside of the grid both are minus infinity.
        """
        cells, inside = self.grid.cells_of(points)
        with np.errstate(divide="ignore"):
            own = np.log(np.where(inside, self._probabilities[cells], 0.0) / self.grid.spacing**2)
        uniform = -2.0 * math.log(self.grid.spacing * self.grid.count)
        return own, np.where(inside, uniform, -np.inf)


class CenterPrior(NamedTuple):
    """A motion model's density of each particle's center: an isotropic Gaussian.

    Attributes:
        mean: (N, 2), pixels.
        std: (N, 1) or (1,) standard deviation along each axis, pixels, > 0.
    """

    mean: NDArray[np.float64]
    std: NDArray[np.float64]


class ProposedCenters(NamedTuple):
    """Centers drawn from the search proposal.

    Attributes:
        centers: (N, 2), row i drawn for particle i.
        log_prior: (N,) log p(center | particle i of the last frame).
        log_ratio: (N,) log p - log q, to be added to the log weights.
    """

    centers: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    log_ratio: NDArray[np.float64]


def propose_from_search(
    predicted_centers: NDArray[np.float64],
    prior: CenterPrior,
    grid_density: GridDensity,
    share: float,
    generator: np.random.Generator,
) -> ProposedCenters:
    """Replace a share of the particles' centers by draws from the likelihood on a grid.

    Prior:    p(x) = (1 - j) N(x; mean, std^2) + j U(x), with the probability j of a jump and the
              grid's uniform density U.
    Proposal: q(x) = share G(x) + (1 - share) N(x; mean, std^2), with the grid density G.

    Args:
        predicted_centers: (N, 2) centers drawn from the motion model's N, pixels.
        prior: The motion model's density of the centers.
        grid_density: The likelihood over the grid, as a density.
        share: Probability, above 0 up to `LARGEST_SHARE`, that a center is drawn from the grid.
        generator: Source of randomness.
    """
    count = len(predicted_centers)
    jump = _JUMP_PROBABILITY
    from_grid = generator.random(count) < share
    centers = np.where(from_grid[:, None], grid_density.draw(count, generator), predicted_centers)

    log_motion = _log_density(centers, prior.mean, prior.std)
    log_grid, log_uniform = grid_density.log_densities(centers)
    log_prior = np.logaddexp(math.log1p(-jump) + log_motion, math.log(jump) + log_uniform)
    log_mixture = np.logaddexp(math.log(share) + log_grid, math.log1p(-share) + log_motion)
    return ProposedCenters(centers, log_prior, log_prior - log_mixture)


def _log_density(
    values: NDArray[np.float64], mean: NDArray[np.float64], std: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,) log density of a Gaussian with independent axes.

    Args:
        values: (N, D).
        mean: (N, D).
        std: Standard deviations, broadcastable to (N, D).
    """
    offsets = (values - mean) / std
    return -(0.5 * np.square(offsets) + np.log(std) + 0.5 * _LOG_TWO_PI).sum(axis=1)
