"""Images that come faster than they are looked at: the newest is taken, and none gets old."""

import time
from itertools import count

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription

DEADLINE = 60.0
BUSY = 0.02
PAIRS = 40


class Flood:
    """Looks at images slowly, while two more come for each; numbers are their heights.

    Attributes:
        published: How many images were, up to each that was looked at.
        seen: Numbers of those that were looked at.
    """

    def __init__(self, context, overrides):
        self.node = Node("watcher", context=context, parameter_overrides=overrides)
        self.published, self.seen = [], []
        quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._images = self.node.create_publisher(Image, "image", quality)
        self._numbers = count(1)
        self._last = 0
        self.input = ImageSubscription(self.node, self._look, pytest.fail)
        self.input.open("raw", "auto")
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)

    def run(self):
        self.wait_for(self._images.get_subscription_count)
        (subscription,) = self.node.subscriptions
        self.wait_for(subscription.get_publisher_count)
        self._publish()
        self.wait_for(lambda: len(self.seen) == PAIRS)

    def wait_for(self, condition):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.02)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()

    def _look(self, image):
        self.published.append(self._last)
        self.seen.append(image.height)
        for _ in range(2):
            self._publish()
        time.sleep(BUSY)

    def _publish(self):
        self._last = next(self._numbers)
        self._images.publish(Image(height=self._last))
        # It waits for whoever subscribes then.
        assert self._images.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE))


@pytest.fixture
def flood(graph):
    floods = []

    def make(**overrides):
        given = [Parameter(name, value=value) for name, value in overrides.items()]
        floods.append(Flood(graph.context(), given))
        return floods[-1]

    yield make
    for one in floods:
        one.close()


def test_the_newest_of_the_images_that_wait_is_taken(flood):
    found = flood()
    found.run()
    behind = [last - seen for last, seen in zip(found.published, found.seen, strict=True)]
    # The first few may come from a hold-up, and so may some where this machine held it up.
    assert set(behind) == {0, 1}
    assert behind.count(0) > PAIRS / 2


def test_images_that_were_asked_for_wait(flood):
    found = flood(**{"qos_overrides./image.subscription.depth": 2})
    found.run()
    behind = [last - seen for last, seen in zip(found.published, found.seen, strict=True)]
    assert behind == [0, *[1] * (PAIRS - 1)]
