"""Targets by hand that are found again by their looks, with no detector beside them."""

import numpy as np
import pytest

INTERVAL = 0.1


def last_boxes(tracker, drawn, frames):
    """(frames, targets, 4) of the targets that the first frame shows, all started by hand."""
    for box in drawn.boxes[0]:
        tracker.start(drawn.images[0], box)
    return np.array(
        [
            [target.estimate.box for target in tracker.update(image, INTERVAL)]
            for image in drawn.images[1:frames]
        ]
    )


GONE, BACK = 10, 40
# A turn of a lost one comes every five frames.
SOON = BACK + 5
# In windows, one after another, it takes so many frames to have looked everywhere.
WINDOWS = 77
PLACES = [(250.0, 120.0), (290.0, 40.0), (40.0, 170.0)]


@pytest.fixture(params=PLACES)
def comes_back(draw, request):
    """One that is gone for 3 s and then stands elsewhere; by how many others that stand still."""

    def drawn(others):
        steps = np.arange(BACK + WINDOWS + 1)
        path = np.stack([60.0 + 0 * steps, 90.0 + 0 * steps], 1)
        path[GONE:BACK] = np.nan
        path[BACK:] = request.param
        stands = np.stack([150.0 + 0 * steps, 40.0 + 0 * steps], 1)
        return draw([path, *[stands] * others])

    return drawn


@pytest.mark.parametrize("seed", range(3))
def test_a_lost_one_is_found_within_a_moment_wherever_it_is(comes_back, make_tracker, iou, seed):
    drawn = comes_back(others=1)
    boxes = last_boxes(make_tracker(seed), drawn, SOON + 1)
    assert all(iou(drawn.boxes[0][0], box) > 0.5 for box, _ in boxes[: GONE - 1])
    assert iou(drawn.boxes[SOON][0], boxes[-1][0]) > 0.5
    assert all(iou(drawn.boxes[0][1], other) > 0.5 for _, other in boxes)


def test_where_nothing_is_looked_for_elsewhere_it_stays_lost(comes_back, make_tracker, iou):
    drawn = comes_back(others=1)
    tracker = make_tracker(redetection__windows=0)
    boxes = last_boxes(tracker, drawn, len(drawn.images))
    assert all(iou(drawn.boxes[-1][0], box) == 0.0 for box, _ in boxes[BACK - 1 :])
    assert [target.estimate.state for target in tracker.targets] == ["lost", "tracking"]


@pytest.mark.parametrize("seed", range(3))
def test_an_only_one_is_found_by_when_all_windows_are_looked_at(
    comes_back, make_tracker, iou, seed
):
    drawn = comes_back(others=0)
    tracker = make_tracker(seed)
    ((box,),) = last_boxes(tracker, drawn, len(drawn.images))[-1:]
    assert iou(drawn.boxes[-1][0], box) > 0.5
    (target,) = tracker.targets
    assert target.estimate.state == "tracking"


def test_one_that_is_gone_is_not_taken_for_its_twin(twins, make_tracker, iou):
    images = [image.copy() for image in twins.images]
    x, y, width, height = twins.boxes[0][0].astype(int)
    for image in images[8:]:
        image[y : y + height, x : x + width] = image[y - height : y, x : x + width]
    boxes = last_boxes(make_tracker(), type(twins)(images, twins.boxes), len(images))
    assert max(iou(*pair) for pair in boxes) < 0.5
    assert iou(twins.boxes[-1][1], boxes[-1][1]) > 0.7


def test_of_two_alike_that_are_lost_one_is_found_where_one_is(twins, make_tracker, iou):
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


def test_one_that_a_detector_knew_is_found_as_well_once_there_is_none(returner, make_tracker, iou):
    tracker = make_tracker()
    name = tracker.start(returner.images[0], returner.boxes[0][0])
    images = [*returner.images[1:10], *[returner.images[20]] * 90, *[returner.images[-1]] * 30]
    for number, image in enumerate(images, 1):
        told = tracker.update(image, INTERVAL, returner.detections(5) if number == 5 else None)
    (target,) = told
    assert target.id == name
    assert iou(returner.boxes[-1][0], target.estimate.box) > 0.5


@pytest.mark.parametrize("seed", range(2))
def test_one_drawn_on_a_frame_gone_by_is_not_taken_for_its_twin(
    twins, make_tracker, iou, seed, start_earlier
):
    images = [image.copy() for image in twins.images]
    x, y, width, height = twins.boxes[0][0].astype(int)
    for image in images[22:]:
        image[y : y + height, x : x + width] = image[y - height : y, x : x + width]
    tracker = make_tracker(seed, track__lost_after=0.2)
    for number, image in enumerate(images[:38]):
        seen = twins.detections(number, targets=[1]) if number % 2 == 0 else None
        tracker.update(image, INTERVAL, seen)
    name = start_earlier(tracker, twins.boxes[20][0], 17 * INTERVAL)
    (target,) = (one for one in tracker.targets if one.id == name)
    assert target.estimate.state == "lost"
    assert iou(twins.boxes[0][1], target.estimate.box) == 0.0
