"""Images on another topic than where they are waited for, found in a real graph."""

import pytest
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.image_topics import image_publisher_hint, image_subscriber_hint


@pytest.fixture
def waiting(graph):
    """A node that waits, beside a client that publishes `/image`."""
    client, node = graph.client(), graph.client(namespace="/waiting")
    node.destroy_publisher(node.images)
    client.wait_for(lambda: node.count_publishers("/image"), "discovery")
    return client, node


def test_a_topic_that_is_published_needs_no_advice(waiting):
    assert image_publisher_hint(waiting[1], "/image") == ""


def test_topics_with_images_are_named_with_how_to_take_the_first(waiting):
    _, node = waiting
    assert image_publisher_hint(node, "/waiting/image") == (
        ": nobody publishes /waiting/image, but /image (-r image:=/image)"
    )


def test_of_many_topics_a_few_are_named_and_compressed_ones_get_their_transport(waiting):
    client, node = waiting
    topics = [f"/a{number}/compressed" for number in range(4)]
    for topic in topics:
        client.create_publisher(CompressedImage, topic, 1)
    client.wait_for(lambda: all(node.count_publishers(topic) for topic in topics), "discovery")
    assert image_publisher_hint(node, "/none") == (
        ": nobody publishes /none, but /a0/compressed, /a1/compressed, /a2/compressed and 2 more "
        "(-r image:=/a0 -p image_transport:=compressed)"
    )


def test_raw_images_beside_a_topic_of_compressed_ones_are_taken_by_transport_or_name(waiting):
    _, node = waiting
    said = ": nobody publishes /image/compressed, but /image ("
    for compressed, cure in ((True, "-p image_transport:=raw"), (False, "-r image:=/image")):
        found = image_publisher_hint(node, "/image/compressed", compressed=compressed)
        assert found == f"{said}{cure})"


def test_what_a_node_publishes_itself_is_no_camera(graph):
    node = graph.client()
    node.destroy_publisher(node.images)
    node.create_publisher(Image, "~/overlay", 1)
    node.wait_for(lambda: node.count_publishers("/client/overlay"), "its own topic")
    assert image_publisher_hint(node, "/none") == (
        ": nobody publishes /none, nor other images, with ROS_DOMAIN_ID "
        f"{node.context.get_domain_id()}"
    )


def test_subscribers_elsewhere_are_named_if_they_take_the_same_kind(waiting):
    client, node = waiting
    client.create_subscription(Image, "/raw", lambda message: None, 1)
    client.create_subscription(CompressedImage, "/camera/compressed", lambda message: None, 1)
    client.wait_for(
        lambda: node.count_subscribers("/raw") and node.count_subscribers("/camera/compressed"),
        "discovery",
    )
    raw = image_subscriber_hint(node, "/image", compressed=False)
    assert raw == " (there is one of /raw: -r image:=/raw)"
    client.create_subscription(CompressedImage, "/z", lambda message: None, 1)
    client.wait_for(lambda: node.count_subscribers("/z"), "discovery")
    other = image_subscriber_hint(node, "/camera/compressed", compressed=True)
    assert other == " (there is one of /z: -r image/compressed:=/z)"
    compressed = image_subscriber_hint(node, "/image/compressed", compressed=True)
    assert compressed == " (there is one of /camera/compressed: -r image:=/camera)"
    assert image_subscriber_hint(node, "/raw", compressed=False) == ""


def test_what_a_tracker_makes_of_images_is_no_camera(waiting, graph):
    client, node = waiting
    graph.tracker()
    client.wait_for(lambda: node.count_publishers("/pf_tracker/overlay"), "the tracker")
    assert image_publisher_hint(node, "/none") == (
        ": nobody publishes /none, but /image (-r image:=/image)"
    )
