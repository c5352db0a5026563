import itertools

import cv2
import numpy as np
import pytest

from pf_tracker_ros.appearances.color_stripes import ColorStripes
from pf_tracker_ros.frames import Frame

BOX = np.array([100.0, 60.0, 24.0, 40.0])
STRIPES = ColorStripes()


def look_at(frame, box):
    return STRIPES.extract(frame, box[None])[0]


def unlikeness(one, other):
    return STRIPES.distance(one, other[None])[0]


def person(shirt, trousers, light=0):
    image = np.full((200, 320, 3), 120, np.uint8)
    image[60:80, 100:124] = shirt
    image[80:100, 100:124] = trousers
    return Frame(cv2.add(image, (light, light, light, 0)))


def test_a_little_more_light_makes_little_difference():
    looks = [look_at(person((40, 42, 170), (60, 50, 40), light), BOX) for light in range(0, 12, 2)]
    assert max(unlikeness(looks[0], look) for look in looks) < 0.12
    steps = [unlikeness(one, other) for one, other in itertools.pairwise(looks)]
    assert max(steps) < 0.03


@pytest.mark.parametrize(
    "other",
    [((170, 42, 40), (60, 50, 40)), ((60, 50, 40), (40, 42, 170)), ((90, 90, 90), (60, 50, 40))],
)
def test_other_clothes_or_the_same_the_other_way_round_are_told_apart(other):
    one = look_at(person((40, 42, 170), (60, 50, 40)), BOX)
    assert unlikeness(one, look_at(person(*other), BOX)) > 0.3


def test_what_is_beside_a_target_hardly_counts():
    frame = person((40, 42, 170), (60, 50, 40))
    beside = frame.image.copy()
    beside[:, :104] = (200, 220, 30)
    one, other = look_at(frame, BOX), look_at(Frame(beside), BOX)
    assert unlikeness(one, other) < 0.05


@pytest.mark.parametrize("box", [(0, 0, 1, 1), (319, 199, 1, 1), (0, 0, 320, 200), (-3, -3, 8, 8)])
def test_a_look_is_one_wherever_the_box_is(box):
    look = look_at(person((40, 42, 170), (60, 50, 40)), np.array(box, float))
    assert np.square(look).sum() == pytest.approx(1.0, abs=1e-5)


def crowd(scale, clothes):
    """A textured image of 320 x 200 times a scale, with people in some clothes side by side."""
    noise = np.random.default_rng(0).integers(90, 150, (25, 40, 3)).astype(np.uint8)
    image = cv2.resize(noise, (320 * scale, 200 * scale), interpolation=cv2.INTER_NEAREST)
    boxes = []
    for place, (shirt, trousers) in enumerate(clothes):
        x, y, width, height = np.array([30 + 50 * place, 60 + 20 * (place % 2), 24, 40]) * scale
        image[y : y + height // 2, x : x + width] = shirt
        image[y + height // 2 : y + height, x : x + width] = trousers
        boxes.append((x, y, width, height))
    return Frame(image), np.array(boxes, dtype=float)


CLOTHES = [
    ((40, 42, 170), (60, 50, 40)),
    ((60, 50, 40), (40, 42, 170)),
    ((170, 42, 40), (60, 50, 40)),
    ((90, 160, 60), (20, 20, 20)),
    ((200, 200, 200), (40, 42, 170)),
]


@pytest.mark.parametrize("scale", [1, 2, 7])
@pytest.mark.parametrize("wanted", range(len(CLOTHES)))
def test_an_image_is_searched_for_a_look(iou, scale, wanted):
    frame, boxes = crowd(scale, CLOTHES)
    size = boxes[0, 2:]
    look = look_at(frame, boxes[wanted])
    first, *others = STRIPES.find(frame, look, size, np.empty((0, 4)), 4)
    assert iou(first, boxes[wanted]) > 0.5
    assert len(others) == 3
    for one, other in itertools.combinations([first, *others], 2):
        assert iou(one, other) < 0.5


def test_what_is_something_else_is_passed_over(iou):
    frame, boxes = crowd(2, CLOTHES[:1] * 3)
    look = look_at(frame, boxes[0])
    found = STRIPES.find(frame, look, boxes[0, 2:], boxes[[0, 2]], 1)
    assert iou(found[0], boxes[1]) > 0.5


@pytest.mark.parametrize("shape", [(200, 320, 3), (200, 320)])
def test_boxes_are_described_together_as_each_by_itself(shape):
    frame = Frame(np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8))
    boxes = np.array([BOX, (0, 0, 1, 1), (-3, -3, 8, 8), BOX + 7, (10, 20, 300, 170)])
    together = STRIPES.extract(frame, boxes)
    np.testing.assert_array_equal(together, [look_at(frame, box) for box in boxes])
    assert STRIPES.extract(frame, np.empty((0, 4))).shape == (0, together.shape[1])


def test_distances_to_several_are_those_to_each():
    frame, boxes = crowd(1, CLOTHES)
    looks = STRIPES.extract(frame, boxes)
    distances = STRIPES.distance(looks[0], looks)
    np.testing.assert_allclose(distances, [unlikeness(looks[0], look) for look in looks], atol=1e-6)
    assert distances[0] == pytest.approx(0.0, abs=1e-6)
    assert distances[1:].min() > 0.3


@pytest.mark.parametrize("shape", [(200, 320, 3), (200, 320), (5, 7, 3), (401, 602)])
@pytest.mark.parametrize("size", [(24.0, 40.0), (3.0, 2.0), (900.0, 900.0)])
def test_centers_of_what_is_alike_are_in_the_image(shape, size):
    image = np.random.default_rng(1).integers(0, 255, shape).astype(np.uint8)
    frame = Frame(image)
    look = look_at(frame, np.array([1.0, 1.0, 3.0, 3.0]))
    for box in STRIPES.find(frame, look, np.array(size), np.empty((0, 4)), 500):
        center = box[:2] + box[2:] / 2
        assert (center >= 0).all()
        assert (center < frame.size).all()
        assert tuple(box[2:]) == size
