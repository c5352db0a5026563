import itertools

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.appearance import look_at, unlikeness

BOX = np.array([100.0, 60.0, 24.0, 40.0])


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
