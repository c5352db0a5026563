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
)

BOX = np.array([100.0, 50.0, 20.0, 80.0])


@pytest.mark.parametrize(
    ("box", "confidence", "expected"),
    [
        # sqrt(20 x 80) is the neutral size of 40 px; 80 / 20 is beyond the largest aspect ratio.
        (BOX, 0.75, [1.0, np.log(3.0), 0.0, np.log(3.0)]),
        (np.array([0.0, 0.0, 160.0, 80.0]), 0.5, [1.0, 0.0, np.log(8.0) / 2, -np.log(2.0)]),
    ],
)
def test_the_features_by_hand(box, confidence, expected):
    np.testing.assert_allclose(box_features(box, confidence), expected, atol=1e-12)


@pytest.mark.parametrize("confidence", [0.0, 1.0])
@pytest.mark.parametrize("size", [(1.0, 2.0), (2000.0, 1000.0), (10.0, 500.0), (500.0, 10.0)])
def test_extremes_are_clamped(confidence, size):
    box = np.array([100.0, 50.0, *size])
    covariance = box_covariance(box, box_features(box, confidence))
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.sqrt(covariance[0, 0]) < box[2]


def test_the_covariance_by_hand():
    features = np.array([1.0, 0.5, -2.0, 0.2])
    x, y, width, height = np.exp(COEFFICIENTS @ features) * [20.0, 80.0, 20.0, 80.0]
    expected = np.diag([x**2, y**2, width**2, height**2])
    expected[2, 3] = expected[3, 2] = SIZE_CORRELATION * width * height
    np.testing.assert_allclose(box_covariance(BOX, features), expected)
    # A random walk of half a box size of 40 px.
    walked = expected + np.diag([400.0, 400.0, 0.0, 0.0])
    np.testing.assert_allclose(box_covariance(BOX, features, 0.5), walked)


def test_it_scales_with_the_image_and_narrows_with_the_confidence():
    std = [
        np.sqrt(np.diag(box_covariance(BOX, box_features(BOX, confidence))))
        for confidence in (0.1, 0.5, 0.9)
    ]
    assert (std[0] > std[1]).all()
    assert (std[1] > std[2]).all()
    features = box_features(BOX, 0.5)
    np.testing.assert_allclose(box_covariance(3 * BOX, features), 9 * box_covariance(BOX, features))


def test_that_of_particles_is_their_weighted_covariance_and_that_of_rounding_to_pixels():
    generator = np.random.default_rng(0)
    boxes = generator.uniform(10.0, 50.0, (30, 4))
    states = boxes[:, :2] + boxes[:, 2:] / 2
    particles = ParticleSet(states, np.log(generator.dirichlet(np.ones(30))))
    values = np.hstack([states, boxes[:, 2:]])
    expected = np.cov(values.T, aweights=particles.weights, ddof=0) + np.eye(4) / 12
    np.testing.assert_allclose(particle_covariance(particles, boxes), expected, atol=1e-9)


def test_that_of_particles_in_one_place_has_an_inverse():
    boxes = np.tile(BOX, (5, 1))
    particles = ParticleSet(boxes[:, :2] + boxes[:, 2:] / 2, np.zeros(5))
    np.testing.assert_allclose(np.linalg.inv(particle_covariance(particles, boxes)), 12 * np.eye(4))
