"""The covariance of a box given that it is on the target."""

import numpy as np
import pytest

from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.tracking.box_covariance import (
    COEFFICIENTS,
    SIZE_CORRELATION,
    box_covariance,
    box_features,
    particle_covariance,
    peak_std,
)

BOX = np.array([100.0, 50.0, 20.0, 80.0])


def centered(x, y):
    """Boxes of the size of `BOX` with these offsets of their centers, pixels."""
    return np.column_stack([BOX[0] + x, BOX[1] + y, np.full(len(x), 20.0), np.full(len(x), 80.0)])


def test_the_features_by_hand():
    """Particles 2 px apart along x (.1 widths) and 16 px along y (.2 heights); half the weight."""
    boxes = centered(np.array([-2.0, 2.0]), np.array([-16.0, 16.0]))
    features = box_features(BOX, 0.75, peak_std(BOX, boxes, np.array([0.5, 0.5])))
    np.testing.assert_allclose(features, [1.0, np.log(3.0), np.log(0.1), np.log(0.2), 0.0])


def test_particles_of_another_peak_do_not_widen_the_one_of_the_box():
    near = centered(np.array([-2.0, 2.0]), np.array([-4.0, 4.0]))
    far = np.vstack([near, near + [60.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        peak_std(BOX, far, np.full(4, 0.25)), peak_std(BOX, near, np.full(2, 0.5))
    )


@pytest.mark.parametrize("confidence", [0.0, 1.0])
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_extremes_are_clamped(confidence, offset):
    std = peak_std(BOX, centered(np.full(3, offset), np.zeros(3)), np.ones(3))
    features = box_features(BOX, confidence, std)
    assert np.isfinite(features).all()
    covariance = box_covariance(BOX, features)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.sqrt(covariance[0, 0]) < 3.0 * BOX[2]


def test_the_covariance_by_hand():
    features = np.array([1.0, 0.5, -2.0, -3.0, 0.2])
    x, y, width, height = np.exp(COEFFICIENTS @ features) * [20.0, 80.0, 20.0, 80.0]
    expected = np.diag([x**2, y**2, width**2, height**2])
    expected[2, 3] = expected[3, 2] = SIZE_CORRELATION * width * height
    np.testing.assert_allclose(box_covariance(BOX, features), expected)
    # A random walk of half a box size of 40 px.
    walked = expected + np.diag([400.0, 400.0, 0.0, 0.0])
    np.testing.assert_allclose(box_covariance(BOX, features, 0.5), walked)


def test_it_scales_with_the_image_and_narrows_with_the_confidence():
    peak = np.array([0.05, 0.02])
    std = [
        np.sqrt(np.diag(box_covariance(BOX, box_features(BOX, confidence, peak))))
        for confidence in (0.1, 0.5, 0.9)
    ]
    assert (std[0] > std[1]).all()
    assert (std[1] > std[2]).all()
    features = box_features(BOX, 0.5, peak)
    np.testing.assert_allclose(box_covariance(3 * BOX, features), 9 * box_covariance(BOX, features))


def test_that_of_particles_is_their_weighted_covariance():
    generator = np.random.default_rng(0)
    boxes = generator.uniform(10.0, 50.0, (30, 4))
    states = boxes[:, :2] + boxes[:, 2:] / 2
    particles = ParticleSet(states, np.log(generator.dirichlet(np.ones(30))))
    values = np.hstack([states, boxes[:, 2:]])
    expected = np.cov(values.T, aweights=particles.weights, ddof=0)
    found = particle_covariance(particles, boxes)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_array_equal(found[:2, :2], particles.covariance)
