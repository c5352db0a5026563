"""What detectors said of frames that are still to come."""

import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.targets.requests import MAX_QUEUED_DETECTIONS, DetectionQueue

SECOND = 1_000_000_000


@pytest.fixture
def answers():
    """Of the frames at 1 s, 2 s and 4 s, and of the next one."""
    waiting = DetectionQueue()
    for seconds in (1, 2, 4, 0):
        waiting.add(answer(seconds), seconds * SECOND)
    return waiting


def answer(number):
    return Detections([[number, 0, 10, 20]], [0.5], [f"of {number}"], age=7.0)


def due(answers, seconds):
    found = answers.due(round(seconds * SECOND))
    return [(*one.detections.labels, one.stamp // SECOND) for one in found]


def test_answers_are_due_with_their_frame_or_a_later_one(answers):
    assert due(answers, 2.5) == [("of 1", 1), ("of 2", 2), ("of 0", 0)]


def test_what_was_found_stays_as_it_was(answers):
    (first, *_) = answers.due(SECOND)
    assert first.detections.boxes.tolist() == [[1, 0, 10, 20]]
    assert first.detections.scores.tolist() == [0.5]


def test_they_wait_until_they_are_forgotten(answers):
    assert due(answers, 2) == due(answers, 2)
    answers.discard_due(2 * SECOND)
    assert due(answers, 2) == []
    assert due(answers, 4) == [("of 4", 4)]


def test_with_a_frame_without_a_stamp_all_are_of_now(answers):
    assert due(answers, 0) == [(f"of {number}", number) for number in (1, 2, 4, 0)]
    answers.discard_due(0)
    assert due(answers, 9) == []


def test_all_can_be_forgotten(answers):
    answers.clear()
    assert due(answers, 9) == []


def test_the_oldest_of_too_many_are_dropped_and_told_of_once():
    answers = DetectionQueue()
    for number in range(1, MAX_QUEUED_DETECTIONS + 1):
        answers.add(answer(number), number * SECOND)
    assert answers.pop_dropped_message() == ()
    for number in (1, 2):
        answers.add(answer(100 + number), (100 + number) * SECOND)
    answers.clear()
    answers.add(answer(3), 3 * SECOND)
    (told,) = answers.pop_dropped_message()
    assert told.startswith(f"2 detector results left out: at most {MAX_QUEUED_DETECTIONS} wait")
    assert answers.pop_dropped_message() == ()


def test_those_that_came_last_are_the_ones_that_stay():
    answers = DetectionQueue()
    for number in range(MAX_QUEUED_DETECTIONS + 3):
        answers.add(answer(number), (50 - number) * SECOND)
    labels = [label for label, _ in due(answers, 50)]
    assert labels == [f"of {number}" for number in range(3, MAX_QUEUED_DETECTIONS + 3)]
