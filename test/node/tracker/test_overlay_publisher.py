"""Pictures that are drawn beside the tracking."""

import threading

from pf_tracker_ros.node.tracker.overlay_publisher import OverlayPublisher

DEADLINE = 30.0


class Topic:
    """Notes what is published."""

    def __init__(self):
        self.published = []

    def publish(self, picture):
        self.published.append(picture)


def test_while_one_is_drawn_the_newest_ones_wait_and_nothing_else_piles_up():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    begun, goes_on = threading.Event(), threading.Event()

    def slow():
        begun.set()
        assert goes_on.wait(DEADLINE)
        return "slow"

    thread.draw(slow)
    assert begun.wait(DEADLINE)
    for number in range(500):
        thread.draw(lambda number=number: number)
    assert thread._executor._work_queue.qsize() == 0
    goes_on.set()
    thread.close()
    assert topic.published == ["slow", *range(490, 500)]
    assert reports == []


def test_one_that_fails_is_told_of_and_the_others_are_published():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    thread.draw(lambda: 1 / 0)
    # Each is done before the next one comes.
    for number in range(2):
        done = threading.Event()
        thread.draw(lambda number=number, done=done: (done.set(), number)[1])
        assert done.wait(DEADLINE)
    thread.draw(lambda: "last")
    thread.close()
    assert topic.published == [0, 1, "last"]
    assert reports == ["the overlay of a frame was not published: division by zero"]
