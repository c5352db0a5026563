"""The hand-held camera: what it does to the world is what it says."""

import numpy as np
import pytest
from scenes.camera import HandheldCamera

SIZE = (160, 120)


def make_camera(**changes):
    given = {"shake": 0.0, "lighting": 0.0, "noise": 0.0} | changes
    generator = np.random.default_rng(3)
    return HandheldCamera(generator, size=SIZE, margin=8, frames=60, **given)


@pytest.fixture
def world():
    rows, columns = np.indices((136, 176), dtype=float)
    bump = np.exp(-0.5 * ((rows - 66.3) ** 2 + (columns - 85.7) ** 2) / 6.0**2)
    return np.repeat((20.0 + 200.0 * bump)[..., None], 3, axis=2).astype(np.uint8)


def test_without_shake_drift_and_noise_it_cuts_out_the_middle(world):
    camera = make_camera()
    assert np.array_equal(camera.shoot(world, 7), world[8:128, 8:168])


def test_shake_moves_the_image_by_the_offset(world):
    camera = make_camera(shake=2.0)
    assert np.ptp(camera.offsets, axis=0).min() > 3.0
    for index in range(0, 60, 7):
        light = camera.shoot(world, index)[..., 0].astype(float) - 20.0
        rows, columns = np.indices(light.shape)
        found = (columns * light).sum() / light.sum(), (rows * light).sum() / light.sum()
        expected = np.array([85.7, 66.3]) - camera.offsets[index]
        assert found == pytest.approx(expected, abs=0.05)


def test_shake_never_looks_over_the_edge_of_the_world():
    offsets = make_camera(shake=40.0).offsets
    assert offsets.min() >= 1.0
    assert offsets.max() <= 15.0


def test_noise_has_the_standard_deviation_asked_for_and_differs_between_frames():
    camera = make_camera(noise=4.0)
    gray = np.full((136, 176, 3), 128, np.uint8)
    first, second = (camera.shoot(gray, index).astype(float) for index in (0, 1))
    assert first.std() == pytest.approx(4.0, rel=0.05)
    assert (first - second).std() == pytest.approx(4.0 * np.sqrt(2), rel=0.05)


def test_lighting_scales_the_image_by_the_gain():
    camera = make_camera(lighting=0.1)
    gray = np.full((136, 176, 3), 128, np.uint8)
    means = [camera.shoot(gray, index).mean() for index in range(60)]
    assert means == pytest.approx(128 * camera.gains, abs=0.51)
    assert camera.gains.std() > 0.02
