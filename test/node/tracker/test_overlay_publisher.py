"""Overlays drawn in a separate thread."""

import threading

from pf_tracker_ros.node.tracker.publishers import OverlayPublisher

DEADLINE = 30.0


class Topic:
    """Stores the published messages."""

    def __init__(self):
        self.published = []

    def publish(self, message):
        self.published.append(message)


def test_the_newest_overlays_wait_while_one_is_drawn():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    started, resume = threading.Event(), threading.Event()

    def slow():
        started.set()
        assert resume.wait(DEADLINE)
        return "slow"

    thread.draw(slow)
    assert started.wait(DEADLINE)
    for number in range(500):
        thread.draw(lambda number=number: number)
    assert thread._executor._work_queue.qsize() == 0
    resume.set()
    thread.close()
    assert topic.published == ["slow", *range(490, 500)]
    assert reports == []


def test_a_failed_overlay_is_reported_and_the_others_are_published():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    thread.draw(lambda: 1 / 0)
    # Each is drawn before the next one is scheduled.
    for number in range(2):
        done = threading.Event()
        thread.draw(lambda number=number, done=done: (done.set(), number)[1])
        assert done.wait(DEADLINE)
    thread.draw(lambda: "last")
    thread.close()
    assert topic.published == [0, 1, "last"]
    assert reports == ["the overlay of a frame was not published: division by zero"]
