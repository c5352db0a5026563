"""The camera model against OpenCV's own projections, and its inverse against itself."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.world import CameraModel

CAMERAS = {
    "none": ((), "plumb_bob"),
    "plumb_bob": ((-0.38, 0.17, 0.001, -0.0007, -0.03), "plumb_bob"),
    "four": ((-0.3, 0.09, 0.001, -0.001), "plumb_bob"),
    "rational_polynomial": (
        (0.5, -0.2, 0.001, -0.002, -0.1, 0.9, -0.1, -0.2),
        "rational_polynomial",
    ),
    "thin prism": (
        (0.5, -0.2, 0.001, -0.002, -0.1, 0.9, -0.1, -0.2, 0.002, -0.001, 0.001, 0.002),
        "rational_polynomial",
    ),
    "equidistant": ((-0.04, 0.01, -0.006, 0.001), "equidistant"),
    "equidistant without": ((), "equidistant"),
}


K = (500.0, 0, 322, 0, 510, 238, 0, 0, 1)


def made(name):
    distortion, model = CAMERAS[name]
    return CameraModel(500.0, 510.0, 322.0, 238.0, 640, 480, distortion, model)


def pixels():
    u, v = np.meshgrid(np.linspace(0, 639, 17), np.linspace(0, 479, 13))
    return np.column_stack([u.ravel(), v.ravel()])


def degrees_between(one, other):
    return np.degrees(
        np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(1))
    )


@pytest.mark.parametrize("name", CAMERAS)
def test_the_projection_is_that_of_opencv(name):
    camera = made(name)
    points = np.random.default_rng(0).uniform((-1, -0.8, 2), (1, 0.8, 4), (200, 3))
    matrix = np.array([[500.0, 0, 322], [0, 510, 238], [0, 0, 1]])
    distortion, model = CAMERAS[name]
    coefficients = np.array(distortion or (0.0,) * 4)
    if model == "equidistant":
        expected = cv2.fisheye.projectPoints(
            points[None], np.zeros(3), np.zeros(3), matrix, coefficients
        )[0]
    else:
        expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, coefficients)[0]
    np.testing.assert_allclose(camera.project(points), expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_are_the_inverse_of_the_projection(name):
    camera = made(name)
    rays = camera.rays(pixels())
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    again = camera.rays(camera.project(rays * 7.0))
    assert degrees_between(rays, again).max() < 1e-4
    # From a direction to the pixel and back, far beyond the accuracy of five iterations.
    angles = np.random.default_rng(1).uniform(-0.45, 0.45, (300, 2))
    true = np.column_stack([np.tan(angles), np.ones(300)])
    true /= np.linalg.norm(true, axis=1)[:, None]
    assert degrees_between(true, camera.rays(camera.project(true))).max() < 1e-3


@pytest.mark.parametrize("name", CAMERAS)
def test_jacobians_are_the_derivatives_of_the_rays(name):
    camera = made(name)
    points = pixels()[5::11]
    _, jacobians = camera.rays_with_jacobians(points)
    for axis, step in enumerate(np.eye(2) * 1e-2):
        numeric = (camera.rays(points + step) - camera.rays(points - step)) / 2e-2
        np.testing.assert_allclose(jacobians[:, :, axis], numeric, atol=1e-8)


def test_a_fisheye_sees_more_than_half_of_the_sphere():
    camera = CameraModel(200.0, 200.0, 320.0, 240.0, 640, 480, (0.0, 0.0, 0.0, 0.0), "equidistant")
    ray = camera.rays([[320.0 + 200.0 * np.radians(100.0), 240.0]])[0]
    expected = [np.sin(np.radians(100.0)), 0.0, np.cos(np.radians(100.0))]
    np.testing.assert_allclose(ray, expected, atol=1e-9)
    np.testing.assert_allclose(camera.project([ray]), [[320.0 + 200.0 * np.radians(100.0), 240.0]])


def test_pixels_beyond_the_fold_of_the_polynomial_have_no_ray():
    # x (1 - x^2) is largest at 1 / sqrt(3): .385.
    camera = CameraModel(100.0, 100.0, 0.0, 0.0, 60, 40, (-1.0, 0.0, 0.0, 0.0))
    rays = camera.rays([[38.0, 0.0], [39.0, 0.0]])
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


@pytest.mark.parametrize("name", CAMERAS)
def test_no_pixels_have_no_rays_and_points_behind_the_camera_no_pixel(name):
    rays, jacobians = made(name).rays_with_jacobians(np.empty((0, 2)))
    assert (rays.shape, jacobians.shape) == ((0, 3), (0, 3, 2))
    assert made(name).project(np.empty((0, 3))).shape == (0, 2)
    if "equidistant" not in name:
        assert np.isnan(made(name).project([[0.1, 0.1, -1.0]])).all()


def calibrated(**options):
    distortion = CAMERAS["plumb_bob"][0]
    return CameraModel.from_calibration(640, 480, "plumb_bob", distortion, K, **options)


def test_binning_and_region_of_interest():
    full = made("plumb_bob")
    part = calibrated(binning=(2, 4), region=(100, 40, 400, 320), image_size=(200, 80))
    # The first binned pixel covers columns 100 and 101 and rows 40 to 43, with center 100.5, 41.5.
    np.testing.assert_allclose(part.rays([[0.0, 0.0]]), full.rays([[100.5, 41.5]]), atol=1e-9)
    np.testing.assert_allclose(part.rays([[10.0, 5.0]]), full.rays([[120.5, 61.5]]), atol=1e-9)
    assert (part.width, part.height) == (200, 80)


def test_rectified_images_have_the_projection_and_no_distortion():
    rectified = calibrated(projection=(400.0, 0, 300, 0, 0, 400, 220, 0, 0, 0, 1, 0))
    np.testing.assert_allclose(rectified.project([[1.0, 0.5, 2.0]]), [[500.0, 320.0]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((640, 480, "plumb_bob", (0.0,) * 5, (0.0,) * 9), "calibrated"),
        ((640, 480, "plumb_bob", (np.nan,) * 5, K), "finite"),
        ((640, 480, "plumb_bob", (0.0,) * 5, (np.inf, *K[1:])), "finite"),
        ((640, 480, "plumb_bob", (0.1,) * 3, K), "3 distortion coefficients; expected 0 or 4 or 5"),
        ((640, 480, "omni", (), K), "'omni'; allowed: plumb_bob, rational_polynomial, equidistant"),
        ((640, 480, "", (), K[:4]), r"4 numbers; expected k \(9\)"),
        ((0, 0, "plumb_bob", (), K), "0 x 0"),
        ((640, 2**32 - 1, "plumb_bob", (), K), "640 x 4294967295"),
        ((640, 480, "plumb_bob", (), (1e7, *K[1:])), "1e[+]07 and 510 px; expected 1 to 1000000"),
        ((640, 480, "plumb_bob", (), (*K[:2], -1e6, *K[3:])), "principal point"),
        ((640, 480, "plumb_bob", (0.1, -1e300, 0, 0, 0), K), "coefficient is -1e[+]300"),
        # Almost all pixels near the axis; a fold at 0.02 degrees; likewise along one axis.
        ((640, 480, "plumb_bob", (1e6, 0, 0, 0, 0), K), "no lens.*expected at least 0.5"),
        ((640, 480, "plumb_bob", (-1e6, 0, 0, 0, 0), K), "no lens.* 0 % of the image"),
        ((640, 480, "plumb_bob", (0, 0, 1e6, 0, 0), K), "no lens"),
        ((640, 480, "equidistant", (1e6, 0, 0, 0), K), "no lens"),
    ],
)
def test_a_calibration_that_cannot_be_says_so(arguments, message):
    with pytest.raises(ValueError, match=message):
        CameraModel.from_calibration(*arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        *(
            ({"region": one}, "outside of the calibrated image of 640 x 480")
            for one in ((2**32 - 1, 0, 64, 64), (600, 0, 64, 64), (0, 0, 640, 481))
        ),
        ({"image_size": (320, 240)}, "640 x 480 px, but these have 320 x 240"),
    ],
)
def test_a_calibration_of_another_image_says_so(options, message):
    with pytest.raises(ValueError, match=message):
        calibrated(**options)
