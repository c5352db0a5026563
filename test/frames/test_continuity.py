"""Cuts to other scenes, by images with noise."""

import copy
import pickle

import numpy as np
import pytest
from common import texture

from pf_tracker_ros.frames.continuity import OTHER_SCENE, Continuity

INTERVAL = 0.04
SHAPE = (120, 160)


@pytest.fixture(scope="module")
def scenes():
    """Two scenes larger than the view."""
    return [texture(seed, 160, 400, cell=16) for seed in (1, 2)]


class Camera:
    """Makes images of scenes with noise."""

    def __init__(self, type=np.uint8):
        self.continuity = Continuity()
        self._draw = np.random.default_rng(0)
        self._type = type

    def noisy(self, image):
        noisy = image + self._draw.normal(0.0, 2.0, image.shape)
        if self._type == np.uint8:
            return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return (7000 + 12 * noisy.mean(axis=2)).astype(self._type)

    def shows(self, image):
        return self.continuity.update(self.noisy(image), INTERVAL)


def at(scene, shift):
    """The view of a scene from a place."""
    return scene[: SHAPE[0], shift : shift + SHAPE[1]]


def after_motion(scene, type=np.uint8, images=25, step=3):
    camera = Camera(type)
    assert {camera.shows(at(scene, step * number)) for number in range(images)} == {1.0}
    return camera, at(scene, step * (images - 1))


@pytest.mark.parametrize("type", [np.uint8, np.uint16, np.float32])
def test_a_cut_lasts_until_the_scene_is_back(scenes, type):
    camera, last = after_motion(scenes[0], type)
    assert {camera.shows(at(scenes[1], 3 * number)) for number in range(60)} == {OTHER_SCENE}
    assert camera.shows(last) == 1.0


@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_pixels_that_are_not_finite_hide_no_cut(scenes, hole):
    camera = Camera(np.float32)
    images = [camera.noisy(at(scenes[0], 3 * number)) for number in range(25)]
    images += [camera.noisy(at(scenes[1], 3 * number)) for number in range(10)]
    images[3][:] = hole
    for image in images:
        image[::3, ::3] = hole
    found = [camera.continuity.update(image, INTERVAL) for image in images]
    assert found[5:] == [1.0] * 20 + [OTHER_SCENE] * 10


def test_another_scene_is_the_present_one_after_five_seconds(scenes):
    camera, _ = after_motion(scenes[0])
    found = [camera.shows(at(scenes[1], number)) for number in range(140)]
    assert found == [OTHER_SCENE] * 125 + [1.0] * 15


@pytest.mark.parametrize(
    ("gain", "is_gray"),
    [(0.5, False), (1.6, False), (0.5, True), (1.6, True), (2.5, True), (3.5, True)],
)
def test_a_jump_of_the_light_and_back_is_no_cut(scenes, gain, is_gray):
    scene = np.repeat(scenes[0].mean(axis=2, keepdims=True), 3, axis=2) if is_gray else scenes[0]
    camera, last = after_motion(scene)
    # 2.5 makes 0.7 of the image white, and 3.5 makes 0.9 of it.
    image = np.clip(gain * last, 0, 255)
    assert {camera.shows(one) for one in [image] * 10 + [last] * 10} == {1.0}


def test_a_cut_to_a_bright_scene_is_one(scenes):
    camera, _ = after_motion(scenes[0])
    image = np.clip(2.5 * at(scenes[1], 0).astype(float), 0, 255)
    assert {camera.shows(image) for _ in range(10)} == {OTHER_SCENE}


def test_an_object_before_a_uniform_background_is_no_cut(scenes):
    camera = Camera()
    for number in range(20):
        image = np.full((*SHAPE, 3), 100, np.uint8)
        x = 20 + 5 * (number % 10)
        image[40:80, x : x + 40] = at(scenes[0], 0)[40:80, 60:100]
        assert camera.shows(image) == 1.0


def test_black_and_white_swapped_is_no_cut(scenes):
    camera, last = after_motion(scenes[0])
    assert {camera.shows(255 - last) for _ in range(10)} == {1.0}


def test_a_scene_that_is_back_after_more_than_five_seconds_is_the_same(scenes):
    camera, last = after_motion(scenes[0])
    assert [camera.shows(at(scenes[1], 0)) for _ in range(130)][-1] == 1.0
    assert camera.shows(last) == 1.0


def test_dark_noise_is_no_cut_from_image_to_image(scenes):
    camera = Camera()
    dark = np.full((*SHAPE, 3), 12, np.uint8)
    assert {camera.shows(dark) for _ in range(100)} == {1.0}


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_independently(scenes, copied):
    camera, last = after_motion(scenes[0])
    camera.shows(at(scenes[1], 0))
    images = [camera.noisy(at(scenes[1], 0)), camera.noisy(last)]
    other = copied(camera.continuity)
    for one in (camera.continuity, other):
        assert [one.update(image, INTERVAL) for image in images] == [OTHER_SCENE, 1.0]


@pytest.mark.parametrize(("gap", "factor"), [(0.4, OTHER_SCENE), (0.6, 1.0)])
def test_after_a_gap_the_camera_may_have_turned(scenes, gap, factor):
    camera, _ = after_motion(scenes[0])
    assert camera.continuity.update(camera.noisy(at(scenes[1], 0)), gap) == factor
    assert {camera.shows(at(scenes[1], 3 * number)) for number in range(1, 20)} == {factor}
