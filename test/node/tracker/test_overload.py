"""Images that arrive faster than they are processed: the newest one is processed next."""

import time
from itertools import count

import pytest
import rclpy
from nodes import DEADLINE, SpunNode, overrides
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from pf_tracker_ros.node.tracker import image_subscription
from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription

BUSY = 0.02
PAIRS = 8


class Overload:
    """Processes images slowly, and publishes two more during each; their heights are numbers.

    Attributes:
        published: Number of published images before each processed one.
        processed: Numbers of the processed images.
    """

    def __init__(self, context, overrides):
        self.node = SpunNode("overloaded", context, parameter_overrides=overrides)
        self.published, self.processed = [], []
        profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._images = self.node.create_publisher(Image, "image", profile)
        self._numbers = count(1)
        self._last = 0
        self.input = ImageSubscription(self.node, self._process, pytest.fail)
        self.input.open("raw", "auto")

    def run(self):
        self.node.wait_for(self._images.get_subscription_count)
        (subscription,) = self.node.subscriptions
        self.node.wait_for(subscription.get_publisher_count)
        self._publish()
        self.node.wait_for(lambda: len(self.processed) == PAIRS)

    def _process(self, image):
        self.published.append(self._last)
        self.processed.append(image.height)
        for _ in range(2):
            self._publish()
        time.sleep(BUSY)

    def _publish(self):
        self._last = next(self._numbers)
        self._images.publish(Image(height=self._last))
        # It waits in the queue of the subscription then.
        assert self._images.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE))


@pytest.fixture
def overload(graph):
    overloads = []

    def make(**given):
        overloads.append(Overload(graph.context(), overrides(given)))
        return overloads[-1]

    yield make
    for one in overloads:
        one.node.close()


def test_the_newest_pending_image_is_processed(overload, monkeypatch):
    # So that no pause of a busy machine counts as one between two images.
    monkeypatch.setattr(image_subscription, "_QUEUED_WITHIN", DEADLINE / BUSY)
    found = overload()
    found.run()
    behind = [last - number for last, number in zip(found.published, found.processed, strict=True)]
    # The first few may be from a hold-up.
    assert behind == [0, 1, 1, *[0] * (PAIRS - 3)]


def test_an_overridden_depth_keeps_images_pending(overload):
    found = overload(**{"qos_overrides./image.subscription.depth": 2})
    found.run()
    behind = [last - number for last, number in zip(found.published, found.processed, strict=True)]
    assert behind == [0, *[1] * (PAIRS - 1)]
