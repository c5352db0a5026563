"""Images as JPEG with a given quality level."""

import itertools

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage

from pf_tracker_ros.node.console.image_encoding import (
    QUALITY_LEVELS,
    QualityLevel,
    encode_image,
    scale_for,
)


@pytest.fixture
def message(image_message):
    def make(height=120, width=160):
        pixels = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
        return image_message(pixels)

    return make


def shape(picture):
    return cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR).shape[:2]


@pytest.mark.parametrize(("scale", "expected"), [(1.0, (120, 160)), (0.5, (60, 80))])
def test_a_picture_has_the_size_of_the_image_at_every_scale(message, scale, expected):
    picture = encode_image(message(), QualityLevel(80, scale))
    assert (picture.width, picture.height) == (160, 120)
    assert shape(picture) == expected


def test_each_quality_level_is_smaller_than_the_previous(message):
    sizes = [len(encode_image(message(576, 768), level).jpeg) for level in QUALITY_LEVELS]
    assert all(less < more for more, less in itertools.pairwise(sizes))
    assert sizes[-1] < 0.1 * sizes[0]


def test_no_picture_is_wider_than_a_screen_or_narrower_than_a_pixel(message):
    assert shape(encode_image(message(10, 4000), QualityLevel(80)))[1] == 1920
    assert shape(encode_image(message(3, 1), QualityLevel(80, 0.125))) == (3, 1)


def test_a_window_gets_no_fewer_pixels_than_it_shows():
    assert scale_for(768, 900) == 1.0
    assert scale_for(768, 400) == 0.75
    assert scale_for(1920, 400) == 0.25
    # Before the first image its width is unknown.
    assert scale_for(0, 400) == 1.0


def test_an_invalid_image_gives_an_error():
    picture = encode_image(CompressedImage(format="jpeg", data=b"none"), QualityLevel(80))
    assert picture.jpeg == b""
    assert picture.error.startswith("the image cannot be shown: ")


@pytest.mark.parametrize(("encoding", "kind"), [("mono16", np.uint16), ("32FC1", np.float32)])
def test_images_of_more_bits_are_bright_enough(image_message, noise, encoding, kind):
    image = noise(channels=1).astype(kind) * 3
    picture = encode_image(image_message(image, encoding=encoding), QualityLevel(80))
    assert cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR).max() > 200
