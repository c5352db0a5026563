"""Detections that wait for their frames."""

import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.targets.requests import MAX_QUEUED_DETECTIONS, DetectionQueue

SECOND = 1_000_000_000


@pytest.fixture
def queue():
    """Of the frames at 1 s, 2 s and 4 s, and of the next one."""
    queue = DetectionQueue()
    for seconds in (1, 2, 4, 0):
        queue.add(detections(seconds), seconds * SECOND)
    return queue


def detections(number):
    return Detections([[number, 0, 10, 20]], [0.5], [f"of {number}"], age=7.0)


def due(queue, seconds):
    found = queue.due(round(seconds * SECOND))
    return [(*one.detections.labels, one.stamp // SECOND) for one in found]


def test_detections_are_due_with_their_frame_or_a_later_one(queue):
    assert due(queue, 2.5) == [("of 1", 1), ("of 2", 2), ("of 0", 0)]


def test_detections_wait_until_they_are_discarded(queue):
    assert due(queue, 2) == due(queue, 2)
    queue.discard_due(2 * SECOND)
    assert due(queue, 2) == []
    assert due(queue, 4) == [("of 4", 4)]


def test_all_are_due_with_a_frame_without_a_stamp(queue):
    assert due(queue, 0) == [(f"of {number}", number) for number in (1, 2, 4, 0)]
    queue.discard_due(0)
    assert due(queue, 9) == []


def test_clear_discards_all(queue):
    queue.clear()
    assert due(queue, 9) == []


def test_the_oldest_of_too_many_are_dropped_and_reported_once():
    queue = DetectionQueue()
    for number in range(1, MAX_QUEUED_DETECTIONS + 1):
        queue.add(detections(number), number * SECOND)
    assert queue.pop_dropped_message() == ()
    for number in (1, 2):
        queue.add(detections(100 + number), (100 + number) * SECOND)
    queue.clear()
    queue.add(detections(3), 3 * SECOND)
    (message,) = queue.pop_dropped_message()
    assert message.startswith(f"2 detector results left out: at most {MAX_QUEUED_DETECTIONS} wait")
    assert queue.pop_dropped_message() == ()


def test_the_last_received_are_kept():
    queue = DetectionQueue()
    for number in range(MAX_QUEUED_DETECTIONS + 3):
        queue.add(detections(number), (50 - number) * SECOND)
    labels = [label for label, _ in due(queue, 50)]
    assert labels == [f"of {number}" for number in range(3, MAX_QUEUED_DETECTIONS + 3)]
