"""Proposals: the weights correct for the proposal."""

import numpy as np
import pytest

from pf_tracker_ros.filter import (
    CenterPrior,
    Gaussian,
    GridDensity,
    ParticleSet,
    SearchGrid,
    propose_from_prediction,
    propose_from_search,
    propose_from_transition,
)
from pf_tracker_ros.filter.resampling import SystematicResampler


class Walk:
    """x_k = 0.5 x_{k-1} + N(0, std^2), in every column."""

    def __init__(self, std=1.0):
        self._std = np.asarray(std)

    def mean(self, states):
        return 0.5 * states

    def std(self, states):
        return self._std


def normal(x, mean, std):
    return np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))


def test_ratio_by_hand_in_one_dimension():
    states = np.linspace(-4.0, 4.0, 200)[:, None]
    prediction = Gaussian([3.0], [[0.25]])
    proposed = propose_from_prediction(states, Walk(2.0), prediction, 0.4, np.random.default_rng(0))
    x = proposed.states[:, 0]
    prior = normal(x, 0.5 * states[:, 0], 2.0)
    mixture = 0.4 * normal(x, 3.0, 0.5) + 0.6 * prior
    np.testing.assert_allclose(np.exp(proposed.log_ratio), prior / mixture)


def test_the_declared_share_comes_from_the_prediction():
    # The two parts of the mixture do not overlap.
    proposed = propose_from_prediction(
        np.zeros((10_000, 2)),
        Walk(),
        Gaussian([1000.0, 1000.0], np.eye(2)),
        0.3,
        np.random.default_rng(0),
    )
    assert (proposed.states[:, 0] > 500).mean() == pytest.approx(0.3, abs=0.02)
    assert ((proposed.states > 500).sum(axis=1) % 2 == 0).all()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_no_ratio_exceeds_the_bound_of_the_mixture(share):
    proposed = propose_from_prediction(
        np.zeros((2000, 1)), Walk(), Gaussian([50.0], [[0.01]]), share, np.random.default_rng(0)
    )
    assert proposed.log_ratio.max() <= -np.log1p(-share) + 1e-12
    assert np.isfinite(proposed.states).all()
    assert not np.isnan(proposed.log_ratio).any()


def test_without_a_share_it_is_the_transition_prior():
    states = np.arange(5.0)[:, None]
    one = propose_from_transition(states, Walk(), np.random.default_rng(7))
    other = propose_from_prediction(
        states, Walk(), Gaussian([9.0], [[1.0]]), 0.0, np.random.default_rng(7)
    )
    np.testing.assert_array_equal(one.states, other.states)
    np.testing.assert_array_equal(other.log_ratio, np.zeros(5))


def test_a_column_without_noise_follows_the_motion_under_every_proposal():
    states = np.stack([np.zeros(100), np.arange(100.0)], axis=1)
    proposed = propose_from_prediction(
        states,
        Walk([1.0, 0.0]),
        Gaussian([20.0, 777.0], np.diag([1.0, 0.0])),
        0.5,
        np.random.default_rng(0),
    )
    np.testing.assert_array_equal(proposed.states[:, 1], 0.5 * states[:, 1])
    assert (proposed.states[:, 0] > 10).any()
    assert np.isfinite(proposed.log_ratio).all()


def test_expectations_are_those_of_the_transition_prior():
    # E[x] = 1 and E[x^2] = 1 + 1 after one step from 2, though 60 % are drawn around 3.
    proposed = propose_from_prediction(
        np.full((200_000, 1), 2.0), Walk(), Gaussian([3.0], [[4.0]]), 0.6, np.random.default_rng(1)
    )
    ratio, x = np.exp(proposed.log_ratio), proposed.states[:, 0]
    for function, expected in ((np.ones_like(x), 1.0), (x, 1.0), (x**2, 2.0)):
        terms = ratio * function
        assert terms.mean() == pytest.approx(expected, abs=4 * terms.std() / np.sqrt(len(x)))


def test_the_filter_agrees_with_an_exact_grid_filter_even_if_the_prediction_is_wrong():
    measurements = (1.0, 3.0, -1.0, 0.5)
    grid = np.linspace(-12, 12, 1201)
    density = normal(grid, 0.0, 2.0)
    transition = normal(grid[:, None], 0.5 * grid[None], 1.5)
    generator = np.random.default_rng(2)
    particles = ParticleSet.uniform(2.0 * generator.standard_normal((40_000, 1)))
    for measurement in measurements:
        # y = x^2 / 4 + N(0, 1) leaves two modes, which no Gaussian can follow.
        density = transition @ density * normal(measurement, grid**2 / 4, 1.0)
        density /= density.sum()
        proposed = propose_from_prediction(
            particles.states, Walk(1.5), Gaussian([2.0], [[1.0]]), 0.5, generator
        )
        likelihood = normal(measurement, proposed.states[:, 0] ** 2 / 4, 1.0)
        particles = particles.move(proposed.states).reweight(
            proposed.log_ratio + np.log(likelihood)
        )
        mean = density @ grid
        assert particles.mean[0] == pytest.approx(mean, abs=0.05)
        variance = density @ (grid - mean) ** 2
        assert particles.covariance[0, 0] == pytest.approx(variance, rel=0.05)
        draws = SystematicResampler().indices(particles.weights, len(particles), generator)
        particles = particles.resample(draws)


def test_invalid_arguments_are_rejected():
    states, generator = np.zeros((3, 1)), np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"allowed: 0 to 0\.95"):
        propose_from_prediction(states, Walk(), Gaussian([0.0], [[1.0]]), 1.0, generator)
    with pytest.raises(ValueError, match="2 columns; expected 1"):
        propose_from_prediction(states, Walk(), Gaussian([0.0, 0.0], np.eye(2)), 0.5, generator)
    with pytest.raises(ValueError, match="positive definite"):
        propose_from_prediction(states, Walk(), Gaussian([0.0], [[0.0]]), 0.5, generator)


def propose_on_grid(share, log_likelihood, count=40_000, seed=0):
    """Centers predicted at (10, 20) with standard deviation 4, and a 20 x 20 px grid."""
    generator = np.random.default_rng(seed)
    prior = CenterPrior(np.full((count, 2), [10.0, 20.0]), np.array([4.0]))
    drawn = prior.mean + prior.std * generator.standard_normal((count, 2))
    grid = SearchGrid(np.array([12.0, 22.0]), 2.0, 10)
    density = GridDensity(grid, log_likelihood)
    return drawn, grid, propose_from_search(drawn, prior, density, share, generator)


def test_cells_of_a_grid():
    grid = SearchGrid(np.array([12.0, 22.0]), 2.0, 3)
    np.testing.assert_allclose(grid.centers[[0, 1, 3, 8]], [[10, 20], [12, 20], [10, 22], [14, 24]])
    cells, inside = grid.cells_of(grid.centers)
    np.testing.assert_array_equal(cells, np.arange(9))
    assert inside.all()
    _, inside = grid.cells_of(np.array([[8.9, 22.0], [9.1, 22.0], [12.0, 25.1], [12.0, 24.9]]))
    assert inside.tolist() == [False, True, False, True]


@pytest.mark.parametrize("share", [0.01, 0.5, 0.9])
def test_expectations_after_a_search_are_those_of_the_prior(share):
    """The prior is a Gaussian, mixed with a tenth of the grid's uniform density."""
    jump = 0.1
    log_likelihood = -np.linspace(0.0, 6.0, 100)
    _, _, proposed = propose_on_grid(share, log_likelihood)
    particles = ParticleSet(proposed.centers, proposed.log_ratio)
    expected = (1 - jump) * np.array([10.0, 20.0]) + jump * np.array([12.0, 22.0])
    np.testing.assert_allclose(particles.mean, expected, atol=0.15)
    second = (1 - jump) * (16.0 + 100.0) + jump * (20.0**2 / 12 + 144.0)
    assert particles.weights @ proposed.centers[:, 0] ** 2 == pytest.approx(second, rel=0.03)


def test_a_share_is_drawn_from_the_likely_cells():
    log_likelihood = np.full(100, -50.0)
    log_likelihood[37] = 0.0
    drawn, grid, proposed = propose_on_grid(0.7, log_likelihood)
    cells, inside = grid.cells_of(proposed.centers)
    moved = (proposed.centers != drawn).any(axis=1)
    assert moved.mean() == pytest.approx(0.7, abs=0.02)
    assert (cells[moved] == 37).all()
    assert inside[moved].all()
    within = proposed.centers[moved] - grid.centers[37]
    assert np.abs(within).max() <= 1.0
    np.testing.assert_allclose(within.std(axis=0), 2.0 / np.sqrt(12.0), rtol=0.02)


def test_no_ratio_of_a_search_exceeds_its_bound():
    """A center far from the prediction has the weight of the prior's uniform part."""
    log_likelihood = -np.linspace(0.0, 300.0, 100)
    _, _, proposed = propose_on_grid(0.9, log_likelihood)
    assert np.isfinite(proposed.log_ratio).all()
    # The mixture has 0.1 of the motion's density; a jump has 0.1, spread over 400 px^2.
    _, inside = SearchGrid(np.array([12.0, 22.0]), 2.0, 10).cells_of(proposed.centers)
    offsets = (proposed.centers - [10.0, 20.0]) / 4.0
    motion = np.exp(-0.5 * (offsets**2).sum(axis=1)) / (2 * np.pi * 16.0)
    prior = 0.9 * motion + 0.1 / 400.0 * inside
    np.testing.assert_allclose(proposed.log_prior, np.log(prior), rtol=1e-6)
    assert (np.exp(proposed.log_ratio) <= prior / (0.1 * motion) + 1e-9).all()
