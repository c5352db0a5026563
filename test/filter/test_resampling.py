"""Resampling schemes: unbiased, within their bounds, and only below the threshold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pf_tracker_ros.filter import (
    RESAMPLERS,
    EffectiveSampleSizeResampler,
    ElitistResampler,
    ParticleSet,
    ResamplingParameters,
    build_resampler,
)
from pf_tracker_ros.parameters import build

raw_weights = arrays(float, st.integers(1, 30), elements=st.floats(0, 1)).filter(
    lambda weights: weights.sum() > 1e-3
)
any_drawing = given(
    weights=raw_weights.map(lambda weights: weights / weights.sum()),
    count=st.integers(1, 60),
    seed=st.integers(0, 1000),
)
every_scheme = pytest.mark.parametrize("scheme", sorted(RESAMPLERS))


def draw_counts(scheme, weights, count, seed):
    indices = RESAMPLERS[scheme]().indices(weights, count, np.random.default_rng(seed))
    assert indices.shape == (count,)
    return np.bincount(indices, minlength=len(weights))


@every_scheme
@any_drawing
def test_a_particle_of_weight_zero_is_never_drawn(scheme, weights, count, seed):
    counts = draw_counts(scheme, weights, count, seed)
    assert counts.sum() == count
    assert (counts[weights == 0.0] == 0).all()


@every_scheme
def test_the_mean_number_of_copies_is_count_times_weight(scheme):
    weights = np.array([0.05, 0.4, 0.1, 0.25, 0.2])
    runs = np.array([draw_counts(scheme, weights, 20, seed) for seed in range(2000)])
    # The multinomial scheme has the largest standard error, sqrt(20 * 0.24 / 2000) = 0.05.
    np.testing.assert_allclose(runs.mean(axis=0), 20 * weights, atol=0.2)


@pytest.mark.parametrize(
    ("scheme", "bounds"),
    [("systematic", (-1, 1)), ("stratified", (-2, 2)), ("residual", (-1, np.inf))],
)
@any_drawing
def test_copies_deviate_from_the_expected_number_within_bounds(
    scheme, bounds, weights, count, seed
):
    deviations = draw_counts(scheme, weights, count, seed) - count * weights
    assert (deviations > bounds[0] - 1e-9).all()
    assert (deviations < bounds[1] + 1e-9).all()


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual"])
def test_equal_weights_draw_every_particle_once(scheme):
    counts = draw_counts(scheme, np.full(50, 1 / 50), 50, seed=3)
    np.testing.assert_array_equal(counts, np.ones(50))


def test_multinomial_draws_vary_more_than_systematic_ones():
    weights = np.full(20, 1 / 20)
    multinomial = np.var([draw_counts("multinomial", weights, 20, s) for s in range(200)])
    systematic = np.var([draw_counts("systematic", weights, 20, s) for s in range(200)])
    assert multinomial > 0.5 > systematic


def test_a_uniform_number_next_to_one_stays_inside():
    class LargestNumber:
        def random(self, count=None):
            largest = np.nextafter(1.0, 0.0)
            return largest if count is None else np.full(count, largest)

    for resampler in RESAMPLERS.values():
        indices = resampler().indices(np.full(3, 1 / 3), 3, LargestNumber())
        assert indices.max() <= 2


def test_resamples_only_below_the_threshold():
    resampler = EffectiveSampleSizeResampler(RESAMPLERS["systematic"](), threshold=0.5)
    generator = np.random.default_rng(0)
    states = np.arange(4.0)[:, None]
    even = ParticleSet(states, np.log([0.3, 0.3, 0.2, 0.2]))
    uneven = ParticleSet(states, np.log([0.97, 0.01, 0.01, 0.01]))
    assert resampler.resample(even, 4, generator) is even
    resampled = resampler.resample(uneven, 4, generator)
    assert (resampled.states == 0.0).sum() >= 3
    np.testing.assert_allclose(resampled.weights, 0.25)


def test_a_threshold_of_one_always_resamples_and_of_zero_never():
    generator = np.random.default_rng(0)
    even = ParticleSet.uniform(np.zeros((4, 1)))
    uneven = ParticleSet(np.zeros((2, 1)), np.array([0.0, -50.0]))
    always = EffectiveSampleSizeResampler(RESAMPLERS["systematic"](), threshold=1.0)
    never = EffectiveSampleSizeResampler(RESAMPLERS["systematic"](), threshold=0.0)
    assert always.resample(even, 4, generator) is not even
    assert never.resample(uneven, 2, generator) is uneven


def test_a_change_of_the_particle_count_resamples():
    resampler = EffectiveSampleSizeResampler(RESAMPLERS["systematic"](), threshold=0.0)
    particles = ParticleSet(np.array([[1.0], [2.0]]), np.log([0.25, 0.75]))
    more = resampler.resample(particles, 400, np.random.default_rng(0))
    assert len(more) == 400
    assert (more.states == 2.0).mean() == pytest.approx(0.75)


@every_scheme
@any_drawing
def test_the_elitist_resampler_always_draws_the_particle_of_the_largest_weight(
    scheme, weights, count, seed
):
    indices = ElitistResampler(RESAMPLERS[scheme]()).indices(
        weights, count, np.random.default_rng(seed)
    )
    assert indices.shape == (count,)
    assert np.argmax(weights) in indices
    assert (weights[indices] > 0.0).all()


def test_the_elitist_resampler_changes_at_most_one_draw():
    weights = np.array([0.3, 0.3, 0.4])
    missed = 0
    for seed in range(50):
        drawn = RESAMPLERS["multinomial"]().indices(weights, 3, np.random.default_rng(seed))
        kept = ElitistResampler(RESAMPLERS["multinomial"]()).indices(
            weights, 3, np.random.default_rng(seed)
        )
        assert (drawn != kept).sum() == (2 not in drawn)
        missed += 2 not in drawn
    # 0.6^3 of 50 is 11.
    assert 3 < missed < 20


def resampler_of(**values):
    return build_resampler(build(ResamplingParameters, values))


def test_the_parameters_name_scheme_and_threshold():
    states = np.arange(100.0)[:, None]
    particles = ParticleSet(states, np.where(states[:, 0] == 42.0, 0.1, 0.0))
    kept = resampler_of(scheme="multinomial_elitist", threshold=1.0)
    drawn = resampler_of(scheme="multinomial", threshold=1.0)
    survived = [
        [42.0 in r.resample(particles, 100, np.random.default_rng(s)).states for s in range(40)]
        for r in (kept, drawn)
    ]
    assert all(survived[0])
    assert not all(survived[1])
    rare = resampler_of(scheme="multinomial_elitist", threshold=0.5)
    assert rare.resample(particles, 100, np.random.default_rng(0)) is particles
