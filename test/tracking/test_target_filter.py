"""One frame of a target: what is expected of it, and the step that the frame then is."""

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame

INTERVAL = 0.04
every_preset = pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015", "zhang_bo"])


def begun(target_filter, couple, boxes, seed=3):
    draw = GeneratorState.of(np.random.default_rng(seed))
    return target_filter.initialize(Frame(couple.images[0]), tuple(boxes[0]), draw)


@pytest.mark.parametrize("preset", ["li2007", "zhang2015", "zhang_bo"])
def test_what_is_known_beside_the_pixels_is_one_more_factor_of_the_likelihood(
    preset, make_target_filter, couple
):
    """w' is w exp(e), and the box is the mean of the particles under it."""
    target_filter = make_target_filter(preset, {"resampling.threshold": 0.0})
    target, frame = begun(target_filter, couple, couple.first), Frame(couple.images[1])

    def external_likelihood(boxes):
        return -0.5 * boxes[0]

    plain, led = (
        target_filter.step(*target_filter.predict([(target, True)], frame, INTERVAL), one)
        for one in (None, external_likelihood)
    )
    np.testing.assert_array_equal(plain.particles.states, led.particles.states)
    boxes = target.motion.boxes(plain.particles.states)
    expected = plain.particles.weights * np.exp(-0.5 * (boxes[:, 0] - boxes[:, 0].min()))
    np.testing.assert_allclose(led.particles.weights, expected / expected.sum(), atol=1e-12)
    assert led.estimate.box[0] < plain.estimate.box[0]


@every_preset
def test_what_is_expected_of_a_target_depends_on_no_other_that_is_expected_with_it(
    preset, make_target_filter, couple
):
    target_filter = make_target_filter(preset)
    targets = [begun(target_filter, couple, boxes) for boxes in (couple.first, couple.second)]
    for number in range(1, 5):
        frame = Frame(couple.images[number])
        alone = [
            target_filter.step(
                *target_filter.predict([(one, True)], Frame(couple.images[number]), INTERVAL)
            )
            for one in targets
        ]
        together = target_filter.predict([(one, True) for one in targets], frame, INTERVAL)
        targets = [target_filter.step(one) for one in together]
        assert [one.estimate for one in targets] == [one.estimate for one in alone]


def test_a_prediction_without_a_target_is_none(make_target_filter, couple):
    assert make_target_filter("default").predict([], Frame(couple.images[0]), INTERVAL) == []


@pytest.mark.parametrize("searches_everywhere", [True, False])
def test_a_lost_target_is_looked_for_all_over_the_image_only_where_nobody_else_does(
    make_target_filter, couple, searches_everywhere
):
    target_filter = make_target_filter("default", {"track.lost_after": 0.2})
    target = begun(target_filter, couple, couple.first)
    x, y, side, _ = couple.first[0].astype(int)
    ground = couple.images[couple.hidden[0]].copy()
    ground[:, x + side :] = ground[:, :1]
    there = ground.copy()
    there[120:150, 200:230] = couple.images[0][y : y + side, x : x + side]
    for image in [couple.images[0]] * 3 + [ground] * 15 + [there] * 120:
        (expected,) = target_filter.predict([(target, True)], Frame(image), INTERVAL)
        target = target_filter.step(expected, searches_everywhere=searches_everywhere)
    is_there = np.abs(np.array(target.estimate.box) - [200, 120, side, side]).max() < 6.0
    assert is_there == searches_everywhere
    assert (target.estimate.state == "tracking") == searches_everywhere
