"""Adaptive number of particles: as many as the belief's spread asks for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros.filter import (
    AdaptiveNumberParameters,
    AdaptiveResampler,
    ParticleSet,
    build_scheme,
    particles_needed,
)
from pf_tracker_ros.filter.resampling import ResamplingParameters

MOST = 500


def resampled(centers, weights=None, sides=20.0, resampling=None, **values):
    """Resampled particles whose states are (N, 2) centers of boxes of equal sides."""
    centers = np.asarray(centers, dtype=float)
    sides = np.broadcast_to(sides, len(centers))[:, None]
    boxes = np.hstack([centers - sides / 2, sides, sides])
    weights = np.ones(len(centers)) if weights is None else weights
    with np.errstate(divide="ignore"):
        particles = ParticleSet(centers, np.log(weights))
    parameters = AdaptiveNumberParameters(**({"error": 0.1, "fewest": 10} | values))
    scheme = build_scheme(resampling or ResamplingParameters())
    resampler = AdaptiveResampler(scheme, parameters)
    return resampler.resample(particles, boxes, MOST, np.random.default_rng(0))


def test_the_number_follows_from_the_chi_square_quantile():
    """Against tabulated quantiles of 0.99 for 2, 10, 30 and 100 degrees of freedom."""
    quantiles = np.array([9.210, 23.209, 50.892, 135.807])
    needed = particles_needed(np.array([3, 11, 31, 101]), 0.05)
    np.testing.assert_allclose(needed, quantiles / 0.1, rtol=0.01)
    assert particles_needed(np.array([1]), 0.05) == 1.0


def test_no_error_at_all_would_take_more_particles_than_there_can_be(recwarn):
    assert particles_needed(np.array([3]), 5e-324) == np.inf
    centers = np.arange(200)[:, None] * [30.0, 0.0]
    assert len(resampled(centers, error=5e-324)) == MOST
    assert not recwarn.list


def test_a_belief_in_one_place_takes_the_fewest():
    assert len(resampled(np.full((200, 2), 50.0))) == 10
    assert len(resampled(np.full((200, 2), 50.0), fewest=70)) == 70


def test_particles_without_weight_do_not_spread_the_belief():
    centers = np.random.default_rng(0).uniform(0.0, 500.0, (200, 2))
    alone = np.zeros(200)
    alone[7] = 1.0
    found = resampled(centers, alone)
    assert len(found) == 10
    assert (found.states == centers[7]).all()


def test_a_belief_over_some_bins_takes_as_many_particles_as_they_need():
    """5 places of weight 1/5 in 5 bins, all of which 500 draws meet: 13.28 / 0.2 are needed."""
    places = np.arange(5)[:, None] * [30.0, 0.0] + 11.0
    found = resampled(np.repeat(places, 40, axis=0))
    assert len(found) == int(np.ceil(particles_needed(np.array([5]), 0.1)[0])) == 67
    assert len(np.unique(found.states, axis=0)) == 5


def test_sizes_are_told_apart_as_places_are():
    same, different = np.full(200, 20.0), np.repeat([20.0, 30.0, 45.0, 70.0], 50)
    centers = np.full((200, 2), 50.0)
    assert len(resampled(centers, sides=different)) > len(resampled(centers, sides=same))


def test_the_best_particle_goes_on_where_that_is_promised():
    """Twice as likely as each of 399 others, chance mostly passes it over."""
    centers = np.full((400, 2), 50.0)
    centers[123, 0] = 51.0
    weights = np.ones(400)
    weights[123] = 2.0
    found = resampled(centers, weights, resampling=ResamplingParameters(keep_best=True))
    assert len(found) < 40
    assert 51.0 in found.states[:, 0]


def test_the_number_never_exceeds_the_most():
    everywhere = np.random.default_rng(0).uniform(0.0, 5000.0, (400, 2))
    assert len(resampled(everywhere)) == MOST
    assert len(resampled(everywhere, fewest=10_000)) == MOST


@pytest.mark.parametrize("scheme", ["systematic", "multinomial"])
def test_what_is_drawn_is_in_proportion_to_the_weights(scheme):
    """Over 8 bins, in a number that stops short of the most."""
    places = np.arange(8)[:, None] * [30.0, 0.0]
    weights = np.arange(1.0, 9.0)
    found = resampled(places, weights, resampling=ResamplingParameters(scheme), error=0.03)
    assert 200 < len(found) < MOST
    share = [(found.states[:, 0] == place).mean() for place in places[:, 0]]
    np.testing.assert_allclose(share, weights / weights.sum(), atol=0.06)


@settings(deadline=None)
@given(
    st.integers(1, 60),
    st.floats(0.001, 10.0),
    st.integers(1, 1000),
    st.floats(0.001, 10.0),
)
def test_there_is_always_a_particle_and_never_one_too_many(count, error, fewest, bin_size):
    centers = np.random.default_rng(count).normal(0.0, 30.0, (count, 2))
    found = resampled(centers, error=error, fewest=fewest, bin_size=bin_size)
    assert min(fewest, MOST) <= len(found) <= MOST
    np.testing.assert_allclose(found.weights.sum(), 1.0)
