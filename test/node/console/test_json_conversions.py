"""The tracker's messages as JSON."""

import base64
import json
from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import Image, PointCloud2

from pf_tracker_ros.node.console.json_conversions import (
    diagnostic_status_to_json,
    likelihood_to_json,
    pack_frame,
    particles_to_json,
)


def cloud(rows, columns=6):
    """Particles as the node publishes them: x, y, z, width, height, weight, and possibly an id."""
    table = np.array(rows, np.float32).reshape(-1, columns)
    data = array("B", table.tobytes())
    return PointCloud2(point_step=4 * columns, width=len(table), height=1, data=data)


def test_numeric_values_of_a_status_become_numbers():
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN,
        message="hidden",
        values=[
            KeyValue(key=key, value=value)
            for key, value in {"state": "occluded", "confidence": "0.25", "x": "nan"}.items()
        ],
    )
    converted = diagnostic_status_to_json(status)
    assert converted == {
        "level": "warn",
        "message": "hidden",
        "values": {"state": "occluded", "confidence": 0.25, "x": "nan"},
    }
    json.dumps(converted, allow_nan=False)


def test_long_texts_are_cut():
    value = KeyValue(key="k" * 10_000, value="v" * 10_000)
    status = DiagnosticStatus(message="m" * 100_000, values=[value] * 10_000)
    assert len(json.dumps(diagnostic_status_to_json(status))) < 10_000_000 / 2


def test_weights_of_any_size_are_relative_to_the_largest():
    message = cloud([[1, 2, 0, 4, 5, 1e-40], [1, 2, 0, 4, 5, -3e38]])
    assert [share for _, _, share in particles_to_json(message)] == [1.0, 0.0]


@pytest.mark.parametrize("ids", [(), (1, 2)])
def test_particles_are_sorted_by_weight(ids):
    rows = [(1, 2, 0, 5, 5, 0.25, *ids[:1]), (3, 4, 0, 5, 5, 0.5, *ids[1:])]
    found = particles_to_json(cloud(rows, columns=len(rows[0])))
    assert found == [[3.0, 4.0, 1.0], [1.0, 2.0, 0.5]]


def test_of_many_particles_the_heaviest_are_kept():
    rows = [(i, 0, 0, 1, 1, i + 1) for i in range(1000)]
    shown = particles_to_json(cloud(rows))
    assert [x for x, _, _ in shown] == list(range(999, 599, -1))


@pytest.mark.parametrize(
    "message",
    [
        cloud([]),
        cloud([(1, 1, 0, 1, 1, 0.0)]),
        cloud([(float("nan"), 1, 0, 1, 1, 1.0)]),
        PointCloud2(point_step=12, data=array("B", bytes(24))),
        PointCloud2(point_step=24, is_bigendian=True, data=array("B", bytes(24))),
    ],
)
def test_a_cloud_without_valid_particles_gives_none(message):
    assert particles_to_json(message) == []


def likelihood(values, **fields):
    data = array("B", np.array(values, "<f4").tobytes())
    shape = {"width": len(values[0]), "height": len(values), "encoding": "32FC1"}
    return Image(data=data, **(shape | fields))


def test_the_heat_map_scales_the_log_likelihood_below_its_maximum():
    found = likelihood_to_json(likelihood([[-110.0, -100.0], [-120.0, float("nan")]]))
    assert found["columns"] == 2
    assert list(base64.b64decode(found["values"])) == [127, 255, 0, 0]


@pytest.mark.parametrize(
    "message",
    [
        Image(),
        likelihood([[0.0]], encoding="mono8"),
        likelihood([[0.0]], width=3),
        likelihood([[0.0]], is_bigendian=1),
        likelihood([[float("nan")]]),
        Image(width=2**20, height=2**20, encoding="32FC1"),
    ],
)
def test_an_invalid_likelihood_image_gives_none(message):
    assert likelihood_to_json(message) is None


def test_a_packed_frame_has_header_and_picture():
    message = pack_frame({"stamp": "7", "text": "ü"}, b"jpeg")
    length = int.from_bytes(message[:4], "big")
    assert json.loads(message[4 : 4 + length]) == {"stamp": "7", "text": "ü"}
    assert message[4 + length :] == b"jpeg"
