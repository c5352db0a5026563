"""A live node survives any received data, reports it once, and keeps tracking."""

import os
from array import array
from pathlib import Path

import pytest
from geometry_msgs.msg import Point32, PointStamped, Polygon, PolygonStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nodes import NEVER_OCCLUDED as QUICK
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros.cues import CUES
from pf_tracker_ros.decoding.image_decoding import ENCODINGS
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

# Set PF_TRACKER_CASES for a longer test.
CASES = int(os.environ.get("PF_TRACKER_CASES", "0"))
DECLARATIONS = declarations(NodeParameters) | declarations(TrackerParameters)


def test_an_image_needs_no_more_memory_than_its_data(graph, client, images):
    graph.tracker(client, **QUICK)
    before = _peak_bytes()
    for encoding in ENCODINGS:
        for width, height in ((32_000, 32_000), (2**31, 2**31), (32_000, 2)):
            message = Image(width=width, height=height, encoding=encoding)
            message.step, message.data = min(8 * width, 2**32 - 1), array("B", bytes(1000))
            message.header.stamp.sec = 1
            assert client.send(message).values["frame"] == "refused"
    assert _peak_bytes() - before < 30_000_000


def test_a_target_needs_no_memory_for_its_points(graph, client, images, box):
    graph.tracker(client, **QUICK)
    before = _peak_bytes()
    corners = [Point32(x=1.0, y=2.0)] * 400_000
    client.targets.publish(PolygonStamped(polygon=Polygon(points=corners)))
    assert client.targets.wait_for_all_acked(Duration(seconds=60))
    status = client.show(images[0], client.at(0))
    assert status.level == "WARN"
    assert "its message has 4800" in status.message
    assert "allowed: up to 65536" in status.message
    # The copies of DDS, two in this process, but no Python object for each point.
    assert _peak_bytes() - before < 60_000_000
    client.point_at(box)
    assert client.show(images[0], client.at(1)).values["frame"] == "started"


def _peak_bytes():
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = [line for line in lines if line.startswith("VmHWM")]
    return 1024 * int(line.split()[1])


# Any messages in any order

UINT32 = st.integers(0, 2**32 - 1)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), UINT32) | st.tuples(
    st.integers(0, 3), st.integers(0, 10**9 - 1)
)
COORDINATES = st.floats(width=32) | st.floats(-50, 200, width=32)
IMAGES = st.tuples(
    st.just("image"),
    st.fixed_dictionaries(
        {
            "data": st.binary(max_size=64).map(lambda data: array("B", data)),
            "width": UINT32 | st.integers(0, 9),
            "height": UINT32 | st.integers(0, 9),
            "step": UINT32 | st.integers(0, 40),
            "encoding": st.sampled_from(sorted(ENCODINGS))
            | st.text(
                st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9
            ),
            "is_bigendian": st.integers(0, 255),
        }
    ),
    STAMPS,
)
VALID_IMAGES = st.tuples(st.just("valid image"), st.integers(0, 19), STAMPS)
TARGETS = st.tuples(
    st.just("target"), st.lists(st.tuples(COORDINATES, COORDINATES), max_size=4), STAMPS
)
CLICKS = st.tuples(st.just("click"), st.tuples(st.floats(), st.floats()), STAMPS)
SERVICES = st.tuples(st.sampled_from(["stop", "pause", "resume"]), st.none(), st.none())


def valid(declaration):
    if declaration.type == tuple[str, ...]:
        return st.lists(st.sampled_from(declaration.choices or ("person", "car")), unique=True)
    if declaration.choices:
        return st.sampled_from(declaration.choices)
    if declaration.type is bool:
        return st.booleans()
    # Few particles keep the test quick.
    most = 200 if declaration.name == "particles" else declaration.maximum
    if declaration.type is int:
        return st.integers(int(declaration.minimum), int(most))
    number = st.floats(declaration.minimum, most)
    length = max(declaration.lengths, default=0)
    if declaration.type is float:
        return number
    return st.lists(number, min_size=length, max_size=length)


def parameters(names, value):
    return st.lists(st.sampled_from(names).flatmap(value), min_size=1, max_size=3)


ANY_VALUE = (
    st.integers(-(2**63), 2**63 - 1)
    | st.floats()
    | st.booleans()
    | st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
    | st.lists(st.floats(), min_size=1, max_size=5)
    | st.lists(st.sampled_from([*CUES, "smell"]), max_size=3)
)
FIXED = {"image_transport", "image_reliability", "autostart", "max_targets"}
NAMES = sorted(set(DECLARATIONS) - FIXED)
SETS = st.tuples(
    st.just("parameters"),
    parameters(NAMES, lambda name: st.tuples(st.just(name), ANY_VALUE))
    | parameters(NAMES, lambda name: st.tuples(st.just(name), valid(DECLARATIONS[name]))),
    st.none(),
)
EVENTS = st.one_of(IMAGES, VALID_IMAGES, TARGETS, CLICKS, SERVICES, SETS)


class Sender:
    """Sends events to a tracker without waiting for the results."""

    def __init__(self, client, images):
        self._client, self._images = client, images
        self._clicks = client.create_publisher(PointStamped, "pf_tracker/click", 1)
        self._stop = client.create_client(Trigger, "pf_tracker/stop")
        self._enable = client.create_client(SetBool, "pf_tracker/enable")
        for service in (self._stop, self._enable):
            client.wait_for(service.service_is_ready, "service")

    def send(self, kind, content, stamp):
        if kind == "image":
            message = Image(**content)
        elif kind == "valid image":
            message = self._client.message(self._images[content], 0)
        elif kind == "target":
            message = PolygonStamped()
            message.polygon.points = [Point32(x=x, y=y) for x, y in content]
        elif kind == "click":
            message = PointStamped()
            message.point.x, message.point.y = content
        elif kind == "parameters":
            self.set(content)
            return
        else:
            service, request = {
                "stop": (self._stop, Trigger.Request()),
                "pause": (self._enable, SetBool.Request(data=False)),
                "resume": (self._enable, SetBool.Request(data=True)),
            }[kind]
            self._client.call(service.call_async, request)
            return
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        publisher = {"target": self._client.targets, "click": self._clicks}
        publisher.get(kind, self._client.images).publish(message)

    def set(self, values):
        parameters = [Parameter(name, value=value) for name, value in values]
        request = self._client.parameters.set_parameters_atomically
        return self._client.call(request, parameters)


def calm():
    """Every parameter at its default, or at a quick value."""
    values = {
        name: declaration.default
        for name, declaration in declarations(NodeParameters).items()
        if name in NAMES
    }
    values |= preset_parameters("li2007") | {"preset": "li2007"}
    values |= {"particles": 20, "track.wrong_box_cost": 0.0}
    return [
        (name, list(value) if isinstance(value, tuple) else value) for name, value in values.items()
    ]


@pytest.mark.slow
@pytest.mark.parametrize("most", [1, 3])
def test_after_any_messages_in_any_order_the_next_target_is_tracked(
    graph, client, images, box, most
):
    graph.tracker(client, max_targets=most, **QUICK)
    sender = Sender(client, images)

    @settings(
        max_examples=CASES or 40,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
    @given(st.lists(EVENTS, max_size=12))
    def check(events):
        for event in events:
            sender.send(*event)
        sender.send("resume", None, None)
        sender.send("stop", None, None)
        assert sender.set(calm()).result.successful
        # After all pending messages.
        client.show(images[0], client.at(1000))
        client.statuses.clear()
        client.boxes.clear()
        client.point_at(box)
        assert client.show(images[0], client.at(0)).values["frame"] == "started"
        assert client.show(images[1], client.at(1)).values["frame"] in ("tracked", "duplicate")

    check()
