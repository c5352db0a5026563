"""Detectors without a model file, and their thread."""

import threading

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.foreign_code import ForeignError
from pf_tracker_ros.targets import built_in_detectors
from pf_tracker_ros.targets.built_in_detectors import (
    DetectorThread,
    MotionDetector,
    PeopleDetector,
)

SECOND = 1_000_000_000
DEADLINE = 30.0


def ground(dtype=np.uint8):
    noise = np.random.default_rng(0).integers(172, 188, (300, 400))
    if dtype == np.uint8:
        return np.repeat(noise[..., None], 3, axis=2).astype(np.uint8)
    return (noise * 20).astype(dtype)


def draw_person(image, x, y, height):
    """A dark silhouette; its box is (x, y, 0.4 height, height)."""
    width, color = 0.4 * height, (50, 50, 50)

    def outline(*corners):
        points = [(int(x + across * width), int(y + down * height)) for across, down in corners]
        cv2.fillPoly(image, [np.array(points)], color)

    head = (int(x + 0.5 * width), int(y + 0.08 * height))
    cv2.ellipse(image, head, (int(0.16 * width), int(0.08 * height)), 0, 0, 360, color, -1)
    outline((0.3, 0.17), (0.7, 0.17), (0.85, 0.25), (0.7, 0.55), (0.3, 0.55), (0.15, 0.25))
    outline((0.28, 0.52), (0.52, 0.52), (0.45, 1.0), (0.25, 1.0))
    outline((0.5, 0.52), (0.72, 0.52), (0.78, 1.0), (0.58, 1.0))
    return image


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_people_are_detected_in_images_of_every_type(iou, dtype):
    image = draw_person(draw_person(ground(dtype), 80, 60, 150), 250, 80, 180)
    found = PeopleDetector().detect(image)
    assert found.labels == ("person", "person")
    assert (found.scores > 0.5).all()
    for box in ((80, 60, 60, 150), (250, 80, 72, 180)):
        assert max(iou(box, one) for one in found.boxes) > 0.6


@pytest.mark.parametrize("shape", [(300, 400, 3), (20, 20, 3), (128, 63)])
def test_images_without_people_give_no_detections(shape):
    found = PeopleDetector().detect(np.full(shape, 128, np.uint8))
    assert len(found) == 0


def moving(frames, dtype=np.uint8):
    """Images of a moving dark block, and its box."""
    for number in range(frames):
        image = ground(dtype)
        x = 20 + 4 * number
        image[100:150, x : x + 30] = 20
        yield image, (x, 100, 30, 50)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_motion_is_detected_once_the_background_is_learned(iou, dtype):
    detector = MotionDetector(seed=1)
    results = [(detector.detect(image, 0.2), box) for image, box in moving(40, dtype)]
    assert results[0][0] is None
    found, box = results[-1]
    assert found.labels == ("moving",)
    assert iou(found.boxes[0], box) > 0.7
    assert 0.5 < found.scores[0] <= 1.0


def test_a_static_image_has_no_motion():
    detector = MotionDetector()
    results = [detector.detect(ground(), 0.2) for _ in range(40)]
    assert len(results[-1]) == 0


def test_another_image_size_resets_the_background_and_the_former_detections():
    """An object that appeared during the training of the background is not detected."""

    def found_last(detector):
        for number in range(30):
            image = np.full((480, 640, 3), 90, np.uint8)
            if number >= 5:
                image[100:150, 136:166] = 250
            found = detector.detect(image, 0.2)
        return found.boxes.tolist()

    detector = MotionDetector()
    for image, _ in moving(30):
        found = detector.detect(image, 0.2)
    assert len(found) == 1
    assert found_last(detector) == found_last(MotionDetector())


@pytest.mark.parametrize("make", [PeopleDetector, MotionDetector])
def test_an_invalid_image_is_refused(make):
    with pytest.raises(ValueError, match="image is"):
        make().detect(np.zeros((5, 5), bool))


class Gate:
    """A detector that waits until it is opened."""

    def __init__(self, error=None):
        self.opened = threading.Event()
        self.seen = []
        self._error = error

    def detect(self, image, interval):
        self.seen.append((image[0, 0], interval))
        assert self.opened.wait(DEADLINE)
        if self._error:
            raise self._error
        return Detections([[1, 2, 30, 40]]) if image[0, 0] else None


@pytest.fixture
def start():
    threads = []

    def make(detector, rate=10.0):
        threads.append((detector, DetectorThread(detector, rate)))
        return threads[-1][1]

    yield make
    for detector, thread in threads:
        detector.opened.set()
        thread.close()


def picture(value):
    return np.full((8, 8), value, np.uint8)


def test_the_detector_does_not_block(start):
    gate = Gate()
    thread = start(gate)
    assert thread.offer(picture(1), SECOND)
    for later in range(1, 5):
        assert not thread.offer(picture(2), (1 + later) * SECOND)
        assert thread.take() is None
    gate.opened.set()
    found = thread.take(wait=True)
    assert (found.stamp, found.detections.boxes.tolist()) == (SECOND, [[1, 2, 30, 40]])
    assert thread.take() is None
    assert [value for value, _ in gate.seen] == [1]


def test_the_rate_limits_the_processed_frames(start):
    gate = Gate()
    gate.opened.set()
    thread = start(gate, rate=10.0)
    looked_at = []
    for number in range(10):
        stamp = SECOND + number * SECOND // 25
        if thread.offer(picture(1), stamp):
            looked_at.append(number)
            assert thread.take(wait=True).stamp == stamp
    assert looked_at == [0, 3, 6, 9]
    assert [interval for _, interval in gate.seen[1:]] == pytest.approx([0.12] * 3)
    # A jump back resets the interval.
    assert thread.offer(picture(1), 5)


def test_a_discarded_result_is_not_returned(start):
    gate = Gate()
    thread = start(gate)
    assert thread.offer(picture(1), 5 * SECOND)
    thread.discard_pending()
    gate.opened.set()
    assert thread.take(wait=True) is None
    assert thread.offer(picture(1), SECOND)
    assert thread.take(wait=True).stamp == SECOND


def test_a_detector_that_is_not_ready_gives_no_result(start):
    gate = Gate()
    gate.opened.set()
    thread = start(gate)
    assert thread.offer(picture(0), 0)
    assert thread.take(wait=True) is None
    assert thread.offer(picture(1), 0)
    assert thread.take(wait=True).stamp == 0


def test_a_detector_without_an_end_does_not_keep_its_user(monkeypatch):
    monkeypatch.setattr(built_in_detectors, "_PATIENCE", 0.1)
    gate = Gate()
    thread = DetectorThread(gate, 5.0)
    thread.offer(picture(1), SECOND)
    thread.close()
    assert thread.take() is None
    gate.opened.set()


def test_an_error_of_the_detector_is_raised_once(start):
    gate = Gate(RuntimeError("no eyes"))
    gate.opened.set()
    thread = start(gate)
    thread.offer(picture(1), SECOND)
    with pytest.raises(ForeignError, match="RuntimeError: no eyes"):
        thread.take(wait=True)
    assert thread.take() is None
    assert thread.offer(picture(1), 2 * SECOND)
