"""Small recordings of every kind, written without the code under test."""

from pathlib import Path

import cv2
import numpy as np
import pytest


@pytest.fixture
def pictures(noise):
    """Five pictures of noise, so that a frame out of place is noticed."""
    return [noise(24, 32, seed=seed) for seed in range(5)]


@pytest.fixture
def write_images():
    """Write pictures as files of the given names."""

    def write(folder: Path, images_by_name) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for name, image in images_by_name.items():
            assert cv2.imwrite(str(folder / name), image)
        return folder

    return write


@pytest.fixture
def make_message(make_stamped, make_polygon):
    """Serialize a message of the common interfaces with a stamp in nanoseconds."""

    def make(message_type, stamp, *, little_endian=True):
        data = np.arange(6, dtype=np.uint8) + stamp % 50
        fields = {
            "sensor_msgs/msg/Image": {
                **{"height": 2, "width": 3, "encoding": "mono8", "is_bigendian": 0, "step": 3},
                "data": data,
            },
            "sensor_msgs/msg/CompressedImage": {"format": "jpeg", "data": data[:5]},
            "geometry_msgs/msg/PolygonStamped": {"polygon": make_polygon((1.0, 2.0))},
        }[message_type]
        return make_stamped(message_type, stamp, little_endian=little_endian, **fields)

    return make


@pytest.fixture
def no_hang(start_alarm):
    """End a test that hangs."""
    start_alarm(20)
