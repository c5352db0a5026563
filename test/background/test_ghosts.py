"""Objects of the first image leave no ghost; new objects stay foreground."""

import numpy as np
import pytest

from pf_tracker_ros.background import BackgroundModel

HEIGHT, WIDTH = 60, 80
HERE, THERE = np.s_[20:40, 10:25], np.s_[20:40, 45:60]


def ground(seed=1):
    """A smooth gradient with little noise."""
    slope = np.linspace(60, 110, WIDTH)[None] + np.random.default_rng(seed).normal(
        0.0, 2.0, (HEIGHT, WIDTH)
    )
    return slope.astype(np.uint8)


def with_object(place, color=False):
    image = ground()
    if color:
        image = np.repeat(image[..., None], 3, axis=2)
    image[place] = 200
    return image


def model_of(image, removes_ghosts):
    draw = np.random.default_rng(0)
    return BackgroundModel(image, draw, reduction=1, removes_ghosts=removes_ghosts)


def share(mask, place):
    return np.mean(mask[place] > 0)


@pytest.mark.parametrize("color", [False, True], ids=["gray", "color"])
def test_the_ghost_of_an_object_in_the_first_image_becomes_background(color):
    before, after = with_object(HERE, color), with_object(THERE, color)
    masks = {}
    for removes_ghosts in (False, True):
        model = model_of(before, removes_ghosts)
        masks[removes_ghosts] = [model.update(after) for _ in range(6)][-1]
    assert share(masks[False], HERE) > 0.5
    assert share(masks[True], HERE) == 0.0
    assert share(masks[True], THERE) == 1.0


@pytest.mark.parametrize("color", [False, True], ids=["gray", "color"])
def test_a_new_object_that_stands_still_stays_foreground(color):
    empty = with_object(np.s_[0:0, 0:0], color)
    model = model_of(empty, removes_ghosts=True)
    masks = [model.update(with_object(THERE, color)) for _ in range(20)]
    assert all(share(mask, THERE) > 0.9 for mask in masks)


def test_what_has_an_outline_in_the_image_stays_foreground():
    """An object that touches its ghost, with half of the outline, and a brightened part."""
    lit = ground()
    lit[:, 40:] += 60
    for first, then, inside in (
        (with_object(HERE), with_object(np.s_[20:40, 20:35]), np.s_[20:40, 27:35]),
        (ground(), lit, np.s_[5:55, 45:]),
    ):
        model = model_of(first, removes_ghosts=True)
        masks = [model.update(then) for _ in range(8)]
        assert share(masks[-1], inside) > 0.9
