"""Exemplars: what the target looked like when it was surely seen."""

import numpy as np
import pytest

from pf_tracker_ros.cues.hog import Hog, HogParameters
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.tracking.exemplars import Exemplars, describe
from pf_tracker_ros.tracking.oriented_gradients import gradient_descriptors

BOX = np.array([10.0, 10.0, 60.0, 60.0])
# Edges of one direction each, so that the descriptors of two directions have nothing in common.
DIRECTIONS = [0.0, 40.0, 80.0, 120.0, 160.0]


def frame(degrees):
    """Waves across one direction."""
    y, x = np.mgrid[:80, :80]
    turn = np.radians(degrees)
    waves = np.sin((x * np.cos(turn) + y * np.sin(turn)) / 3.0)
    return Frame(np.uint8(np.rint(127.0 + 100.0 * waves)))


def with_views(*degrees, confidence=0.9, interval=0.6):
    """Exemplars of these views, the first one at first."""
    exemplars = Exemplars.of(frame(degrees[0]), BOX)
    for one in degrees[1:]:
        exemplars = exemplars.update(frame(one), BOX, interval, confidence)
    return exemplars


def test_a_descriptor_has_unit_length_and_only_its_colors_without_a_gradient():
    assert np.linalg.norm(describe(frame(0), BOX[None])[0]) == pytest.approx(1.0)
    flat = Frame(np.full((80, 80), 90, np.uint8))
    assert np.square(describe(flat, BOX[None])[0]).sum() == pytest.approx(0.3)
    white = Frame(np.full((80, 80), 250, np.uint8))
    assert Exemplars.of(flat, BOX).similarities(white, BOX[None]) == 0.0


def test_the_similarity_is_the_mean_of_the_three_most_similar_exemplars():
    one = Exemplars.of(frame(0), BOX)
    assert one.similarities(frame(0), BOX[None]) == pytest.approx(1.0)
    other = one.similarities(frame(80), BOX[None])
    assert other < 0.7
    # Two views of this direction and one of the other; then a third one of this direction.
    assert with_views(0, 0, 80).similarities(frame(0), BOX[None]) == pytest.approx((2 + other) / 3)
    assert with_views(0, 0, 80, 0).similarities(frame(0), BOX[None]) == pytest.approx(1.0)


def test_exemplars_are_added_each_half_second_while_the_target_is_surely_seen():
    exemplars, counts = Exemplars.of(frame(0), BOX), []
    for _ in range(10):
        exemplars = exemplars.update(frame(0), BOX, 0.2, 0.9)
        counts.append(len(exemplars.descriptors))
    assert counts == [1, 1, 2, 2, 2, 3, 3, 3, 4, 4]
    assert len(with_views(0, 80, confidence=0.7).descriptors) == 1


def test_different_views_stay_and_repeated_ones_make_room():
    """One view a hundred times does not overwrite five others."""
    exemplars = with_views(*DIRECTIONS, *[90.0] * 100)
    assert len(exemplars.descriptors) == 8
    for degrees in DIRECTIONS:
        coefficients = exemplars.descriptors @ describe(frame(degrees), BOX[None])[0]
        assert coefficients.max() == pytest.approx(1.0, abs=1e-5)
    assert exemplars.similarities(frame(90.0), BOX[None]) == pytest.approx(1.0)


def test_gradients_of_a_patch_are_those_of_the_cue_and_of_each_box_alone():
    noise = np.random.default_rng(0).integers(0, 256, (90, 120, 3), np.uint8)
    image = Frame(np.repeat(np.repeat(noise, 3, axis=0), 3, axis=1))
    # Of 36 px, so that no pixel is interpolated.
    boxes = np.array([[40.0, 30.0, 36.0, 36.0], [101.0, 87.0, 36.0, 36.0]])
    together = gradient_descriptors(image, boxes)
    cue = Hog(HogParameters(), cells=(6, 6), bins=9)
    for box, descriptor in zip(boxes, together, strict=True):
        np.testing.assert_array_equal(gradient_descriptors(image, box[None])[0], descriptor)
        expected = np.sqrt(cue.learn(Region(image, box[None]), box).ravel())
        np.testing.assert_allclose(descriptor, expected, atol=1e-5)
