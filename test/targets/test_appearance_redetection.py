"""Redetection of lost manual targets by their appearance, without a detector."""

import numpy as np
import pytest

INTERVAL = 0.1


def last_boxes(tracker, drawn, frames):
    """(frames, targets, 4) of the targets in the first frame, all manually started."""
    for box in drawn.boxes[0]:
        tracker.start(drawn.images[0], box)
    return np.array(
        [
            [target.estimate.box for target in tracker.update(image, INTERVAL)]
            for image in drawn.images[1:frames]
        ]
    )


LEAVES, RETURNS = 10, 40
# A lost target is searched for every fifth frame.
SOON = RETURNS + 5
# Frames until the search windows have covered the image.
WINDOWS = 77
PLACES = [(250.0, 120.0), (290.0, 40.0), (40.0, 170.0)]


@pytest.fixture
def returning(draw):
    """A target that is absent for 3 s, then at a place, and one that stands."""

    def drawn(place):
        path = np.full((RETURNS + WINDOWS + 1, 2), (60.0, 90.0))
        path[LEAVES:RETURNS] = np.nan
        path[RETURNS:] = place
        return draw([path.T, (np.full(len(path), 150), 40)])

    return drawn


@pytest.mark.parametrize(("seed", "place"), enumerate(PLACES))
def test_a_lost_target_is_soon_found_anywhere_in_the_image(
    returning, make_tracker, iou, seed, place
):
    drawn = returning(place)
    boxes = last_boxes(make_tracker(seed), drawn, SOON + 1)
    assert all(iou(drawn.boxes[0][0], box) > 0.5 for box, _ in boxes[: LEAVES - 1])
    assert iou(drawn.boxes[SOON][0], boxes[-1][0]) > 0.5
    assert all(iou(drawn.boxes[0][1], other) > 0.5 for _, other in boxes)


def test_without_redetection_it_stays_lost(returning, make_tracker, iou):
    drawn = returning(PLACES[0])
    tracker = make_tracker(redetection__windows=0)
    boxes = last_boxes(tracker, drawn, len(drawn.images))
    assert all(iou(drawn.boxes[-1][0], box) == 0.0 for box, _ in boxes[RETURNS - 1 :])
    assert [target.estimate.state for target in tracker.targets] == ["lost", "tracking"]


def test_a_lost_target_is_not_found_on_its_twin(twins, make_tracker, iou):
    images = [image.copy() for image in twins.images]
    x, y, width, height = twins.boxes[0][0].astype(int)
    for image in images[8:]:
        image[y : y + height, x : x + width] = image[y - height : y, x : x + width]
    boxes = last_boxes(make_tracker(), type(twins)(images, twins.boxes), len(images))
    assert max(iou(*pair) for pair in boxes) < 0.5
    assert iou(twins.boxes[-1][1], boxes[-1][1]) > 0.7


def test_of_two_lost_twins_one_is_found_where_one_is(twins, make_tracker, iou):
    images = [twins.images[0]] * 8
    empty = twins.images[0].copy()
    for x, y, width, height in twins.boxes[0].astype(int):
        empty[y : y + height, x : x + width] = empty[y - height : y, x : x + width]
    x, y, width, height = twins.boxes[0][0].astype(int)
    there = empty.copy()
    there[150:190, 150:174] = twins.images[0][y : y + height, x : x + width]
    images += [empty] * 30 + [there] * 30
    boxes = last_boxes(make_tracker(), type(twins)(images, twins.boxes), len(images))
    found = sorted(iou((150, 150, 24, 40), box) for box in boxes[-1])
    assert found[1] > 0.7
    assert found[0] < 0.3


def test_a_detected_target_is_found_too_once_there_is_no_detector(returner, make_tracker, iou):
    tracker = make_tracker()
    id = tracker.start(returner.images[0], returner.boxes[0][0])
    images = [*returner.images[1:10], *[returner.images[20]] * 90, *[returner.images[-1]] * 30]
    for number, image in enumerate(images, 1):
        detections = returner.detections(5) if number == 5 else None
        (target,) = tracker.update(image, INTERVAL, detections)
    assert target.id == id
    assert iou(returner.boxes[-1][0], target.estimate.box) > 0.5


@pytest.mark.parametrize("seed", range(2))
def test_a_target_on_an_earlier_frame_is_not_found_on_its_twin(
    twins, make_tracker, iou, seed, start_earlier
):
    images = [image.copy() for image in twins.images]
    x, y, width, height = twins.boxes[0][0].astype(int)
    for image in images[22:]:
        image[y : y + height, x : x + width] = image[y - height : y, x : x + width]
    tracker = make_tracker(seed, track__lost_after=0.2)
    for number, image in enumerate(images[:38]):
        detections = twins.detections(number, targets=[1]) if number % 2 == 0 else None
        tracker.update(image, INTERVAL, detections)
    id = start_earlier(tracker, twins.boxes[20][0], 17 * INTERVAL)
    (target,) = (one for one in tracker.targets if one.id == id)
    assert target.estimate.state == "lost"
    assert iou(twins.boxes[0][1], target.estimate.box) == 0.0
