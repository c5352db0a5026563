"""One frame of a target: prediction and step."""

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame

INTERVAL = 0.04
every_preset = pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015", "zhang_bo"])


@pytest.mark.parametrize("preset", ["li2007", "zhang2015", "zhang_bo"])
def test_an_external_likelihood_is_one_more_factor_of_the_likelihood(
    preset, make_target_filter, couple
):
    """w' = w exp(e), and the box is the mean under these weights."""
    target_filter = make_target_filter(preset, {"resampling.threshold": 0.0})
    state = target_filter.start(couple.images[0], couple.first[0])
    frame = Frame(couple.images[1])

    def external_likelihood(boxes):
        return -0.5 * boxes[0]

    plain, shifted = (
        target_filter.step(*target_filter.predict([(state, True)], frame, INTERVAL), one)
        for one in (None, external_likelihood)
    )
    np.testing.assert_array_equal(plain.particles.states, shifted.particles.states)
    boxes = state.motion.boxes(plain.particles.states)
    expected = plain.particles.weights * np.exp(-0.5 * (boxes[:, 0] - boxes[:, 0].min()))
    np.testing.assert_allclose(shifted.particles.weights, expected / expected.sum(), atol=1e-12)
    assert shifted.estimate.box[0] < plain.estimate.box[0]


@every_preset
def test_a_prediction_does_not_depend_on_the_other_targets(preset, make_target_filter, couple):
    target_filter = make_target_filter(preset)
    boxes = (couple.first[0], couple.second[0])
    states = [target_filter.start(couple.images[0], box) for box in boxes]
    for number in range(1, 5):
        frame = Frame(couple.images[number])
        alone = [
            target_filter.step(
                *target_filter.predict([(one, True)], Frame(couple.images[number]), INTERVAL)
            )
            for one in states
        ]
        together = target_filter.predict([(one, True) for one in states], frame, INTERVAL)
        states = [target_filter.step(one) for one in together]
        assert [one.estimate for one in states] == [one.estimate for one in alone]


def test_the_prediction_of_no_targets_is_empty(make_target_filter, couple):
    assert make_target_filter("default").predict([], Frame(couple.images[0]), INTERVAL) == []


@pytest.mark.parametrize("searches_everywhere", [True, False])
def test_a_lost_target_is_searched_all_over_the_image_only_on_request(
    make_target_filter, couple, searches_everywhere
):
    target_filter = make_target_filter("default", {"track.lost_after": 0.2})
    state = target_filter.start(couple.images[0], couple.first[0])
    x, y, side, _ = couple.first[0].astype(int)
    ground = couple.images[couple.hidden[0]].copy()
    ground[:, x + side :] = ground[:, :1]
    there = ground.copy()
    there[120:150, 200:230] = couple.images[0][y : y + side, x : x + side]
    for image in [couple.images[0]] * 3 + [ground] * 15 + [there] * 120:
        (prediction,) = target_filter.predict([(state, True)], Frame(image), INTERVAL)
        state = target_filter.step(prediction, searches_everywhere=searches_everywhere)
    is_there = np.abs(np.array(state.estimate.box) - [200, 120, side, side]).max() < 6.0
    assert is_there == searches_everywhere
    assert (state.estimate.state == "tracking") == searches_everywhere
