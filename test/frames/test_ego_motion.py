"""Estimated camera motion, compared with the motion that the images were made with."""

import cv2
import numpy as np
import pytest
from common import texture

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.ego_motion import EgoMotion

WIDTH, HEIGHT = 640, 480


@pytest.fixture(scope="module")
def ground():
    """A scene larger than the camera's view."""
    return texture(0, HEIGHT + 400, WIDTH + 400, cell=8)


def seen_from(ground, x, y, degrees=0.0, zoom=1.0):
    """The camera's image, and the (2, 3) matrix from the ground to it."""
    matrix = cv2.getRotationMatrix2D((520.0, 440.0), degrees, zoom)
    matrix[:, 2] -= (200.0 + x, 200.0 + y)
    return cv2.warpAffine(ground, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_AREA), matrix


def motions_of(images):
    ego_motion = EgoMotion()
    return [ego_motion.update(Frame(image)) for image in images]


@pytest.mark.parametrize(
    "moved",
    [
        {"x": 7.0, "y": -4.0},
        {"x": -45.0, "y": 20.0},
        {"x": 0.0, "y": 0.0, "degrees": 2.0},
        {"x": 3.0, "y": 2.0, "degrees": -1.0, "zoom": 1.02},
    ],
)
def test_shift_rotation_and_zoom_are_estimated(ground, moved):
    (before, first), (now, second) = seen_from(ground, 0, 0), seen_from(ground, **moved)
    first_motion, motion = motions_of([before, now])
    assert first_motion is None
    points = np.array([[20, 20, 1], [600, 30, 1], [50, 450, 1], [320, 240, 1]], float).T
    to_ground = np.linalg.inv(np.vstack([first, [0, 0, 1]]))
    expected = second @ to_ground @ points
    assert (motion @ points)[:2] == pytest.approx(expected, abs=0.5)


@pytest.mark.parametrize("size", [(320, 240), (1920, 1080)])
def test_the_motion_is_in_image_pixels(size):
    width, height = size
    scene = texture(1, height, width + 20, cell=max(width // 60, 6))
    _, motion = motions_of([scene[:, :width], scene[:, 12 : 12 + width]])
    assert motion == pytest.approx(np.array([[1, 0, -12], [0, 1, 0], [0, 0, 1]]), abs=0.3)


@pytest.mark.parametrize("kind", ["gray", "uint16", "float32"])
def test_images_of_every_kind(ground, kind):
    images = [seen_from(ground, x, 0)[0][..., 1] for x in (0, 9)]
    if kind != "gray":
        images = [image.astype(kind) * 100 for image in images]
    assert motions_of(images)[1][0, 2] == pytest.approx(-9.0, abs=0.3)


def test_noise_and_an_object_that_fills_half_of_the_image_are_no_camera_motion(ground):
    image, draw = seen_from(ground, 0, 0)[0], np.random.default_rng(2)
    noisy = [np.clip(image + draw.normal(0, 4, image.shape), 0, 255) for _ in range(25)]
    assert motions_of([one.astype(np.uint8) for one in noisy]) == [None] * 25
    bus = texture(3, HEIGHT, 900, cell=8)
    images = []
    for frame in range(12):
        images.append(image.copy())
        images[-1][:, 100:480] = bus[:, 10 * frame : 10 * frame + 380]
    assert motions_of(images) == [None] * 12


def test_a_slow_motion_adds_up(ground):
    motions = motions_of([seen_from(ground, 0.15 * frame, 0.0)[0] for frame in range(81)])
    steps = [motion[0, 2] for motion in motions if motion is not None]
    assert len(steps) < 40
    assert sum(steps) == pytest.approx(-12.0, abs=1.0)


@pytest.mark.parametrize("still", [24, 25])
def test_motion_after_a_long_rest_is_estimated_completely_within_two_frames(ground, still):
    positions = [0] * still + [6, 12, 18, 24]
    motions = motions_of([seen_from(ground, position, 0.0)[0] for position in positions])
    assert motions[:still] == [None] * still
    steps = [0.0 if motion is None else motion[0, 2] for motion in motions[still:]]
    assert sum(steps[:2]) == pytest.approx(-12.0, abs=0.3)
    assert steps[2:] == pytest.approx([-6.0, -6.0], abs=0.3)


@pytest.mark.parametrize(
    "images",
    [
        [np.full((HEIGHT, WIDTH, 3), 90, np.uint8)] * 3,
        [texture(4, 9, 12, cell=8)] * 3,
        [texture(5, 1, 3000, cell=8)] * 3,
        [*(texture(seed, HEIGHT, WIDTH, cell=8) for seed in (6, 7, 8))],
    ],
    ids=["flat", "tiny", "a line", "cuts"],
)
def test_without_trackable_points_there_is_no_motion(images):
    assert motions_of(images) == [None] * 3
