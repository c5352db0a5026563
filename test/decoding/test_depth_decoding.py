"""Depth of each transport in millimeters or meters."""

import struct
from array import array

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.depth_decoding import decode_depth
from pf_tracker_ros.decoding.image_decoding import ImageError


def depth_image(pixels, encoding):
    height, width = pixels.shape
    data = array("B", pixels.tobytes())
    return Image(height=height, width=width, encoding=encoding, step=pixels[0].nbytes, data=data)


def compressed(image_format, data):
    return CompressedImage(format=image_format, data=array("B", data))


def png(pixels):
    return cv2.imencode(".png", pixels)[1].tobytes()


MILLIMETERS = np.array([[0, 800, 65535], [1, 2, 3]], np.uint16)


def test_depth_of_each_transport_is_decoded():
    meters = np.array([[np.nan, 0.8, np.inf]], np.float32)
    assert np.array_equal(decode_depth(depth_image(MILLIMETERS, "16UC1"), 100), MILLIMETERS)
    decoded = decode_depth(depth_image(meters, "32FC1"), 100)
    assert np.array_equal(decoded, meters, equal_nan=True)
    plain = compressed("16UC1; png compressed ", png(MILLIMETERS))
    assert np.array_equal(decode_depth(plain, 100), MILLIMETERS)
    headed = compressed("16UC1; compressedDepth png", bytes(12) + png(MILLIMETERS))
    assert np.array_equal(decode_depth(headed, 100), MILLIMETERS)


def test_quantized_inverse_depth_is_as_its_definition_says():
    numerator, offset = 1000.0, -5.0
    header = struct.pack("<Iff", 0, numerator, offset)
    values = np.array([[0, 95, 495]], np.uint16)
    message = compressed("32FC1; compressedDepth png", header + png(values))
    decoded = decode_depth(message, 100)
    assert decoded.dtype == np.float32
    assert np.allclose(decoded, [[np.nan, 1000 / 100, 1000 / 500]], equal_nan=True)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (depth_image(MILLIMETERS.astype(np.uint8), "mono8"), "16UC1 in millimeters"),
        (compressed("16UC1; compressedDepth rvl", bytes(40)), "format:=png"),
        (compressed("16UC1; compressedDepth png", bytes(4)), "with 4 bytes"),
        (compressed("png", png(MILLIMETERS.astype(np.uint8))), "16 bits a pixel"),
        (compressed("png", png(np.zeros((20, 20), np.uint16))), "100"),
    ],
)
def test_other_depth_is_refused_with_the_reason(message, reason):
    with pytest.raises(ImageError, match=reason):
        decode_depth(message, 100)
