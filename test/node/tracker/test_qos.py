"""Quality of service of a live node: defaults, overrides, reports of incompatible endpoints."""

import itertools

import pytest
import rclpy
from geometry_msgs.msg import PointStamped, PolygonStamped
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.graph_monitor import GraphMonitor

QUICK = {"particles": 20, "image_reliability": "reliable"}
LOSSY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MANUAL = QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC)


def last_error(client):
    return client.health[-1].values["last_error"] if client.health else ""


def endpoint(node, topic, kind="subscriptions"):
    (found,) = getattr(node, f"get_{kind}_info_by_topic")(topic)
    return found.qos_profile


def reliability(node, topic="/image"):
    """Reliability of the only subscription to a topic, empty while it changes."""
    endpoints = node.get_subscriptions_info_by_topic(topic)
    return [endpoint.qos_profile.reliability.name for endpoint in endpoints]


def lossy_camera(graph):
    """A best-effort camera in its own context."""
    camera = rclpy.create_node("lossy", context=graph.context())
    camera.create_publisher(Image, "image", LOSSY)
    return camera


def test_auto_requests_the_reliability_that_all_cameras_offer(graph, images):
    reliable = graph.client()
    node = graph.tracker(reliable)
    assert reliable.show(images[0], reliable.at(0)).values["frame"] == "waiting"
    assert reliability(node) == ["RELIABLE"]
    lossy = lossy_camera(graph)
    reliable.wait_for(lambda: reliability(node) == ["BEST_EFFORT"], "best effort")
    # With its context, as a process ends: the graph may miss the end of a single publisher.
    lossy.destroy_node()
    lossy.context.shutdown()
    reliable.wait_for(lambda: reliability(node) == ["RELIABLE"], "reliable again")
    reliable.destroy_publisher(reliable.images)
    reliable.wait_for(lambda: not node.count_publishers("/image"), "no camera")
    again = graph.client(reliability="BEST_EFFORT")
    again.wait_for(lambda: reliability(node) == ["BEST_EFFORT"], "best effort again")
    stamps = map(again.at, itertools.count(1))

    def arrives():
        # Best effort may lose any frame.
        again.images.publish(again.message(images[0], next(stamps)))
        return [status for status in again.statuses if status.stamp > again.at(0)]

    again.wait_for(arrives, "frame")
    again.report(lambda report: report.values["image_reliability"] == "best_effort")
    assert last_error(again) == ""


def test_auto_requests_the_offered_reliability_of_compressed_images(graph):
    node = graph.tracker(image_transport="compressed")
    camera = graph.client()
    camera.create_publisher(CompressedImage, "image/compressed", LOSSY)
    camera.wait_for(
        lambda: reliability(node, "/image/compressed") == ["BEST_EFFORT"], "best effort"
    )


def test_a_qos_override_of_the_reliability_wins_over_auto(graph):
    name = "qos_overrides./image.subscription.reliability"
    node = graph.tracker(**{name: "best_effort"})
    client = graph.client()
    client.wait_for(client.images.get_subscription_count, "match")
    client.report(lambda report: report.values["image_reliability"] == "best_effort")
    assert reliability(node) == ["BEST_EFFORT"]


OVERRIDE = "change it there, or here with the parameter qos_overrides./pf_tracker/"
# Message type, topic and profile of another node's endpoint, and the report about it.
MISMATCHES = {
    "a publisher": (
        (PolygonStamped, "pf_tracker/target", LOSSY),
        "nothing arrives on /pf_tracker/target from /other (RELIABILITY BEST_EFFORT), but "
        f"/pf_tracker requests RELIABILITY RELIABLE; {OVERRIDE}target.subscription.reliability",
    ),
    "a subscriber of another durability": (
        (PolygonStamped, "pf_tracker/box", LATCHED),
        "/pf_tracker/box does not reach /other (DURABILITY TRANSIENT_LOCAL), but /pf_tracker "
        f"offers DURABILITY VOLATILE; {OVERRIDE}box.publisher.durability",
    ),
    "another policy": (
        (PolygonStamped, "pf_tracker/box", MANUAL),
        "/pf_tracker/box does not reach /other (LIVELINESS MANUAL_BY_TOPIC), but /pf_tracker "
        f"offers LIVELINESS AUTOMATIC; {OVERRIDE}box.publisher.liveliness",
    ),
    "another type": (
        (PointStamped, "pf_tracker/target", 1),
        "nothing arrives on /pf_tracker/target from /other, which publishes "
        "geometry_msgs/msg/PointStamped, but /pf_tracker expects geometry_msgs/msg/PolygonStamped; "
        "publish geometry_msgs/msg/PolygonStamped, or remap one of the two",
    ),
    "compressed images": (
        (CompressedImage, "/eye/compressed", 1),
        "; receive them with -r image:=/eye -p image_transport:=compressed",
    ),
}


@pytest.mark.parametrize("kind", MISMATCHES)
def test_what_does_not_connect_is_reported_with_the_remedy(graph, images, kind):
    (message_type, topic, profile), report = MISMATCHES[kind]
    remapped = ["--ros-args", "-r", "image:=/eye/compressed"]
    client = graph.client()
    graph.tracker(client, cli_args=remapped if "eye" in topic else None, **QUICK)
    other = rclpy.create_node("other", context=graph.context())
    if "box" in topic:
        other.create_subscription(message_type, topic, lambda message: None, profile)
    else:
        other.create_publisher(message_type, topic, profile)
    assert client.wait_for(lambda: last_error(client), "report").endswith(report)
    # It stays in the diagnostics.
    before = len(client.health)
    client.wait_for(lambda: len(client.health) >= before + 3, "diagnostics")
    assert all(report in one.message and one.level == "WARN" for one in client.health[before + 1 :])
    if "eye" not in topic:
        assert client.show(images[0], client.at(0)).message == report
    other.destroy_node()


def test_an_incompatible_publisher_is_reported_once_each_time_it_appears(graph):
    client = graph.client()
    tracker = graph.tracker(client, **QUICK)
    faults = []
    monitor = GraphMonitor(tracker, faults.append)
    for count in (1, 2):
        publisher = client.create_publisher(PolygonStamped, "pf_tracker/target", LOSSY)
        client.wait_for(lambda count=count: len(faults) == count, "report")
        before = len(client.health)
        client.wait_for(lambda before=before: len(client.health) == before + 2, "further polls")
        assert len(faults) == count
        client.destroy_publisher(publisher)
        client.wait_for(lambda: not monitor.lasting, "end")


def test_no_endpoint_has_event_callbacks_but_for_images(graph):
    tracker = graph.tracker()
    endpoints = [*tracker.publishers, *tracker.subscriptions]
    with_events = {one.topic_name for one in endpoints if one.event_handlers}
    # The first is rclpy's own; the images' reports an incompatible camera at once.
    assert with_events == {"/parameter_events", "/image"}


def test_a_late_subscriber_receives_the_last_status(graph, images):
    client = graph.client()
    graph.tracker(client, **QUICK)
    client.show(images[0], client.at(0))
    late = graph.client()
    late.wait_for(lambda: late.statuses, "latched status")
    assert late.statuses[0].values["state"] == "idle"


@pytest.mark.parametrize("transport", ["raw", "compressed"])
def test_qos_is_overridden_by_parameters(graph, transport):
    topic = "/image" if transport == "raw" else "/image/compressed"
    overrides = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable",
        f"qos_overrides.{topic}.subscription.depth": 7,
        "qos_overrides./pf_tracker/box.publisher.durability": "transient_local",
        "qos_overrides./diagnostics.publisher.durability": "transient_local",
    }
    node = graph.tracker(image_transport=transport, **overrides)
    assert endpoint(node, topic).reliability == ReliabilityPolicy.RELIABLE
    for published in ("/pf_tracker/box", "/diagnostics"):
        durability = endpoint(node, published, "publishers").durability
        assert durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert node.get_parameter(f"qos_overrides.{topic}.subscription.depth").value == 7


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("qos_overrides./image.subscription.reliability", "perhaps", "are ignored"),
        ("qos_overrides./imagine.subscription.depth", 3, "has no effect"),
    ],
)
def test_an_invalid_override_is_reported_and_ignored(graph, images, name, value, reason):
    client = graph.client()
    graph.tracker(client, **{name: value, **QUICK})
    status = client.show(images[0], client.at(0))
    assert status.level == "WARN"
    assert reason in status.message
    assert client.show(images[0], client.at(1)).level == "OK"


def test_an_incompatible_camera_is_reported_with_both_sides_and_the_remedy(graph, images):
    camera = graph.client(reliability="BEST_EFFORT")
    graph.tracker(**QUICK)
    text = camera.wait_for(lambda: last_error(camera), "report")
    assert text == (
        "nothing arrives on /image from /client (RELIABILITY BEST_EFFORT), but /pf_tracker "
        "requests RELIABILITY RELIABLE; set image_reliability to auto, or publish reliably"
    )
    assert camera.set_parameters(image_reliability="best_effort").successful
    camera.wait_for(camera.images.get_subscription_count, "match")
