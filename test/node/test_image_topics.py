"""Hints at image topics other than the subscribed one, in a real graph."""

import pytest
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.image_topics import image_publisher_hint, image_subscriber_hint


@pytest.fixture
def waiting(graph):
    """A client that publishes `/image`, and a node that waits for images."""
    client, node = graph.client(), graph.client(namespace="/waiting")
    node.destroy_publisher(node.images)
    client.wait_for(lambda: node.count_publishers("/image"), "discovery")
    return client, node


@pytest.mark.parametrize(
    ("topic", "compressed", "arguments"),
    [
        ("/waiting/image", None, "-r image:=/image"),
        # Raw images of the same camera need another transport or name.
        ("/image/compressed", True, "-p image_transport:=raw"),
        ("/image/compressed", False, "-r image:=/image"),
    ],
)
def test_other_image_topics_are_named_with_the_arguments(waiting, topic, compressed, arguments):
    _, node = waiting
    assert image_publisher_hint(node, "/image") == ""
    options = {} if compressed is None else {"compressed": compressed}
    assert image_publisher_hint(node, topic, **options) == (
        f": {topic} has no publisher, but images are on /image ({arguments})"
    )


def test_three_topics_are_named_and_compressed_ones_need_their_transport(waiting):
    client, node = waiting
    topics = [f"/a{number}/compressed" for number in range(4)]
    for topic in topics:
        client.create_publisher(CompressedImage, topic, 1)
    client.wait_for(lambda: all(node.count_publishers(topic) for topic in topics), "discovery")
    assert image_publisher_hint(node, "/none") == (
        ": /none has no publisher, but images are on /a0/compressed, /a1/compressed, "
        "/a2/compressed and 2 more "
        "(-r image:=/a0 -p image_transport:=compressed)"
    )


def test_own_image_topics_are_left_out(graph):
    node = graph.client()
    node.destroy_publisher(node.images)
    node.create_publisher(Image, "~/overlay", 1)
    node.wait_for(lambda: node.count_publishers("/client/overlay"), "its own topic")
    assert image_publisher_hint(node, "/none") == (
        ": no publisher of /none, nor of other images, with ROS_DOMAIN_ID "
        f"{node.context.get_domain_id()}"
    )


def test_a_subscriber_of_another_topic_is_named_if_its_type_fits(waiting):
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


def test_image_topics_of_a_tracker_are_left_out(waiting, graph):
    client, node = waiting
    graph.tracker()
    client.wait_for(lambda: node.count_publishers("/pf_tracker/overlay"), "the tracker")
    assert image_publisher_hint(node, "/none") == (
        ": /none has no publisher, but images are on /image (-r image:=/image)"
    )
