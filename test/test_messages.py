"""Boxes, images and statuses as messages, and back."""

import math
import tracemalloc
from array import array
from dataclasses import replace

import numpy as np
import pytest
from common import make_estimate
from geometry_msgs.msg import Point32, PolygonStamped
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Header

from pf_tracker_ros.background import BackgroundState
from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.messages import (
    WARN,
    Status,
    box_message,
    box_of_polygon,
    image_message,
    status_message,
)
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.tracking.estimate import estimate_values


@pytest.fixture
def header():
    header = Header(frame_id="camera")
    header.stamp.sec, header.stamp.nanosec = 12, 34
    return header


def polygon(*points):
    message = PolygonStamped()
    message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in points]
    return message


@given(
    st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(1.0, 1e4), st.floats(1.0, 1e4))
)
def test_a_box_survives_the_conversion_to_a_polygon(box):
    assert box_of_polygon(box_message(new_message, Header(), box)) == pytest.approx(box, abs=2e-3)


@pytest.mark.parametrize(
    "points",
    [
        [(10, 20), (40, 60)],
        [(40, 60), (10, 20)],
        [(10, 60), (40, 20)],
        [(25, 20), (40, 60), (10, 50)],
        [(10, 20), (40, 20), (40, 60), (10, 60), (10, 20)],
    ],
)
def test_a_target_is_the_bounding_rectangle_of_its_points(points):
    assert box_of_polygon(polygon(*points)) == (10, 20, 30, 40)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        ([], "0 points"),
        ([(1, 2)], "its polygon has 1 point;"),
        ([(1, 2), (1, 2)], "0 x 0 px"),
        ([(1, 2), (1, 9), (1, 5)], "0 x 7 px"),
        ([(1, 2), (9, 2)], "8 x 0 px"),
        ([(1, 2), (math.nan, 9)], "not finite"),
        ([(1, 2), (3, math.inf)], "not finite"),
    ],
)
def test_a_polygon_without_area_is_refused_with_the_reason(points, reason):
    with pytest.raises(ValueError, match=reason):
        box_of_polygon(polygon(*points))


def test_an_image_survives_the_conversion_to_a_message(header, noise):
    image = noise(height=7, width=5)
    message = image_message(new_message, header, image)
    assert isinstance(message.data, array)
    assert np.array_equal(decode_raw(message), image)
    assert message.header == header
    # One that is not contiguous is packed.
    apart = image[:, ::2]
    assert np.array_equal(decode_raw(image_message(new_message, header, apart)), apart)


def test_a_message_holds_the_only_copy_of_an_image(header, noise):
    image = noise(height=480, width=640)
    tracemalloc.start()
    message = image_message(new_message, header, image)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(message.data) == image.nbytes
    assert most < 1.2 * image.nbytes


def test_numbers_of_a_status_read_back_unchanged(header):
    estimate = make_estimate(
        confidence=0.1,
        box_covariance=np.diag([1 / 3, 2 / 3, 4.0, 5.0]) - 0.5 * np.eye(4)[[1, 0, 3, 2]],
        weights=np.array([0.2, 0.3, 0.5]),
        effective_sample_size=1.7,
        cue_weights={"color_histogram": 0.75, "gradient_orientation": 0.25},
    )
    values = estimate_values(estimate)
    made = Status("/pf_tracker", WARN, "text", values)
    (status,) = status_message(new_message, header, [made]).status
    read = {item.key: float(item.value) for item in status.values}
    assert read == {
        "box_x": 1.0,
        "box_y": 2.0,
        "box_width": 3.0,
        "box_height": 4.0,
        "confidence": 0.1,
        "covariance_xx": 1 / 3,
        "covariance_xy": -0.5,
        "covariance_yy": 2 / 3,
        "covariance_yh": 0.0,
        "covariance_ww": 4.0,
        "covariance_wh": -0.5,
        "covariance_hh": 5.0,
        "effective_sample_size": 1.7,
        "cue_weight_color_histogram": 0.75,
        "cue_weight_gradient_orientation": 0.25,
        "particles": 3,
    }
    assert (status.name, status.level, status.message) == ("/pf_tracker", b"\x01", "text")


def test_what_not_every_estimate_has_is_in_the_status_where_it_is():
    estimate = make_estimate()
    assert not {"reacquired_for", "background"} & estimate_values(estimate).keys()
    off = BackgroundState("off", "the camera moves")
    for given_value, key, text in (
        (0.0, "reacquired_for", 0.0),
        (BackgroundState("ready"), "background", "ready"),
        (off, "background", "off: the camera moves"),
    ):
        assert estimate_values(replace(estimate, **{key: given_value}))[key] == text
