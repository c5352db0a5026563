"""The console's images wait for the tracker's status, unless there is none."""

import pytest
import rclpy
from nodes import DEADLINE, SpunNode
from sensor_msgs.msg import Image
from std_msgs.msg import Empty

from pf_tracker_ros.node.console import deferred_image_input
from pf_tracker_ros.node.console.deferred_image_input import DeferredImageInput

NEVER = 3600.0


class Watcher:
    """A node with a deferred image input; the height of an image is its number.

    Attributes:
        seen: Heights of the received images.
    """

    def __init__(self, context):
        self.node = SpunNode("watcher", context)
        self.seen = []
        self._fences = 0
        self.images = DeferredImageInput(
            self.node, lambda image: self.seen.append(image.height), pytest.fail
        )
        self._publisher = self.node.create_publisher(Image, "image", 10)
        self._fence = self.node.create_publisher(Empty, "fence", 10)
        self.node.create_subscription(Empty, "fence", self._on_fence, 10)
        self.images.open("image")
        self.node.wait_for(
            lambda: (
                all(s.get_publisher_count() for s in self.node.subscriptions)
                and self._publisher.get_subscription_count()
            )
        )

    def publish(self, *heights):
        """Publish images, and wait until they are acknowledged."""
        for height in heights:
            self._publisher.publish(Image(height=height))
        assert self._publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE))

    def pass_by(self):
        """Let the executor process everything up to a message that is published now."""
        before = self._fences
        self._fence.publish(Empty())
        self.node.wait_for(lambda: self._fences > before)

    def idle(self):
        """Let the executor wait for a time."""
        self.node.spinner.spin_once(timeout_sec=0.3)

    def close(self):
        self.images.close()
        self.node.close()

    def _on_fence(self, _):
        self._fences += 1


@pytest.fixture
def start_watcher(graph):
    watchers = []

    def start():
        watchers.append(Watcher(graph.context()))
        return watchers[-1]

    yield start
    for watcher in watchers:
        watcher.close()


@pytest.fixture
def patient(start_watcher, monkeypatch):
    """A watcher without a timeout for the status."""
    monkeypatch.setattr(deferred_image_input, "_TIMEOUT", NEVER)
    return start_watcher()


def test_images_that_wait_do_not_keep_the_executor_busy(patient, monkeypatch):
    checked, can_execute = [], deferred_image_input._Gate.can_execute

    def note(gate, entity):
        checked.append(entity)
        return can_execute(gate, entity)

    monkeypatch.setattr(deferred_image_input._Gate, "can_execute", note)
    patient.images.on_status()
    patient.publish(2, 3)
    patient.pass_by()
    checked.clear()
    patient.idle()
    # For the subscription and its event, each time that the executor begins to wait.
    assert 1 <= len(checked) <= 8


def test_of_many_that_wait_the_newest_are_kept(patient):
    patient.publish(1)
    patient.node.wait_for(lambda: patient.seen == [1])
    patient.images.on_status()
    patient.publish(*range(2, 22))
    patient.images.on_status()
    assert patient.seen == [1, 14, 15, 16]


def test_images_that_come_faster_than_answers_do_not_wait_for_a_second(patient, monkeypatch):
    now = [100.0]
    patient.images.on_status()
    patient.publish(2, 3, 4, 5)
    with monkeypatch.context() as patch:
        patch.setattr(deferred_image_input.time, "monotonic", lambda: now[0])
        patient.images.on_status()
        assert patient.seen == [2, 3, 4]
    patient.node.wait_for(lambda: patient.seen == [2, 3, 4, 5])
    with monkeypatch.context() as patch:
        patch.setattr(deferred_image_input.time, "monotonic", lambda: now[0])
        now[0] += 1.1
        patient.images.on_status()
    patient.publish(6)
    patient.pass_by()
    assert patient.seen == [2, 3, 4, 5]
    patient.images.on_status()
    assert patient.seen == [2, 3, 4, 5, 6]


def test_images_do_not_wait_for_a_silent_tracker(start_watcher):
    watcher = start_watcher()
    watcher.publish(1)
    watcher.node.wait_for(lambda: watcher.seen == [1])
    watcher.images.on_status()
    watcher.publish(2)
    watcher.node.wait_for(lambda: watcher.seen == [1, 2])
    # From then on no image waits.
    watcher.publish(3)
    watcher.node.wait_for(lambda: watcher.seen == [1, 2, 3])


def test_no_image_is_taken_while_it_is_closed(patient):
    patient.images.on_status()
    patient.images.close()
    assert patient.images.topic == ""
    patient.images.on_status()
    assert patient.seen == []
    patient.images.open("image")
    patient.node.wait_for(lambda: all(s.get_publisher_count() for s in patient.node.subscriptions))
    patient.publish(4)
    patient.images.on_status()
    assert patient.seen == [4]
