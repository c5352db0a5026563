"""The size response cue: a target that grew or shrank is told by how much."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues import FrameMaps, SizeResponse, SizeResponseParameters

PARAMETERS = SizeResponseParameters()
CUE = SizeResponse(PARAMETERS)
CENTER = np.array([160.0, 120.0])
SIDES = np.array([60.0, 44.0])
STEPS = np.arange(-8, 9)


def texture(seed, height, width, grain=2.5):
    noise = np.random.default_rng(seed).normal(size=(height, width))
    smooth = cv2.GaussianBlur(noise, (0, 0), grain)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def frame(factor=1.0, seed=0):
    """A textured target of `SIDES` times a factor around `CENTER`, before a background."""
    target = texture(99, 44, 60)
    image = texture(seed, 240, 320, grain=6.0)
    first = CENTER - factor * SIDES / 2 + factor / 2 - 0.5
    matrix = np.array([[factor, 0.0, first[0]], [0.0, factor, first[1]]])
    drawn = cv2.warpAffine(target, matrix, (320, 240), borderMode=cv2.BORDER_REPLICATE)
    inside = cv2.warpAffine(np.full((44, 60), 255, np.uint8), matrix, (320, 240))
    return np.where(inside > 127, drawn, image)


def box_of(factor=1.0, shift=0.0):
    factor = np.asarray(factor, float)[..., None]
    return np.concatenate([CENTER + shift - factor * SIDES / 2, factor * SIDES], axis=-1)


def maps_of(image, boxes):
    return FrameMaps(image, np.atleast_2d(boxes))


@pytest.fixture(scope="module")
def template():
    return CUE.learn(maps_of(frame(), box_of()), box_of())


def answers(image, template, place=None, cue=CUE):
    boxes = box_of(PARAMETERS.step**STEPS)
    maps = maps_of(image, boxes)
    maps.place = box_of() if place is None else place
    return cue.log_likelihood(maps, boxes, template)


@pytest.mark.parametrize("steps", range(-4, 5))
@pytest.mark.parametrize("seed", [0, 1])
def test_the_size_that_was_drawn_is_answered_most(template, steps, seed):
    """Within a step, whether the background is the learned one or another."""
    logs = answers(frame(PARAMETERS.step**steps, seed), template)
    assert abs(STEPS[logs.argmax()] - steps) <= 1
    assert (logs <= 0.0).all()


def test_the_answer_to_the_learned_size_is_the_trained_one(template):
    responses = 1.0 + answers(frame(), template) / PARAMETERS.sharpness
    expected = np.exp(-0.5 * STEPS.astype(float) ** 2)
    np.testing.assert_allclose(responses[6:11], expected[6:11], atol=0.15)
    assert responses[[0, 1, 2, 14, 15, 16]].max() < 0.15


def test_sizes_count_less_the_further_they_are_from_the_place(template):
    """What fits as well at the end of the range as in its middle is answered far less there."""
    by_steps = [
        answers(frame(PARAMETERS.step**steps), template).max() / PARAMETERS.sharpness + 1.0
        for steps in (0, 4, 8)
    ]
    assert by_steps == sorted(by_steps, reverse=True)
    assert by_steps[2] < 0.2 * by_steps[0]


@pytest.mark.parametrize("steps", [-3, 0, 3])
def test_sizes_are_told_around_a_place_of_another_size(template, steps):
    """The place is where the particles are likeliest, not where the target was learned."""
    logs = answers(frame(), template, place=box_of(PARAMETERS.step**steps))
    assert abs(STEPS[logs.argmax()]) <= 1


def test_a_box_is_judged_by_its_size_alone(template):
    maps = maps_of(frame(), box_of())
    square = np.sqrt(SIDES.prod())
    alike = np.array([box_of(), box_of(shift=9.0), [100.0, 90.0, square, square]])
    logs = CUE.log_likelihood(maps, alike, template)
    np.testing.assert_allclose(logs, logs[0], atol=1e-6)


def test_between_two_sizes_the_answer_is_between_theirs(template):
    maps = maps_of(frame(), box_of())
    boxes = box_of(PARAMETERS.step ** np.array([1.0, 1.25, 2.0]))
    first, between, second = CUE.log_likelihood(maps, boxes, template)
    assert between == pytest.approx(0.75 * first + 0.25 * second)


def test_beyond_the_sizes_the_ends_are_read(template):
    maps = maps_of(frame(PARAMETERS.step**3), box_of())
    boxes = box_of(PARAMETERS.step ** np.array([-8.0, -9.0, -60.0, 8.0, 9.0, 60.0]))
    logs = CUE.log_likelihood(maps, boxes, template)
    np.testing.assert_allclose(logs[:3], logs[0])
    np.testing.assert_allclose(logs[3:], logs[3])


def test_the_place_is_needed_and_one_box_alone_is_not_judged(template):
    assert CUE.needs_place
    maps = maps_of(frame(), box_of())
    assert CUE.match(CUE.observe(maps, box_of()), template) is None


def test_an_even_image_says_the_same_of_every_size():
    image = np.full((240, 320), 90, np.uint8)
    learned = CUE.learn(maps_of(image, box_of()), box_of())
    np.testing.assert_allclose(answers(image, learned), -PARAMETERS.sharpness)


def test_a_target_at_the_edge_of_the_image_is_learned_and_answered(template):
    image = frame()[:, 140:]
    box = box_of() - [140, 0, 0, 0]
    learned = CUE.learn(maps_of(image, box), box)
    boxes = np.concatenate([box[None] - [0.5, 0.5, -1, -1], box[None]])
    logs = CUE.log_likelihood(maps_of(image, box), boxes, learned)
    assert np.isfinite(logs).all()
    assert logs[1] > -0.15 * PARAMETERS.sharpness


def test_color_images_are_read_as_gray(template):
    color = cv2.cvtColor(frame(), cv2.COLOR_GRAY2BGR)
    learned = CUE.learn(maps_of(color, box_of()), box_of())
    np.testing.assert_allclose(learned.weights, template.weights, atol=1e-6)


def test_adopting_what_was_observed_equals_learning(template):
    maps = maps_of(frame(), box_of())
    adopted = CUE.adopt(CUE.observe(maps, box_of()))
    np.testing.assert_array_equal(adopted.weights, template.weights)


def test_every_third_blend_keeps_the_share_of_three_frames(template):
    """With the default interval: 0.995^3 of the old and the rest of what the third frame shows."""
    image = frame(PARAMETERS.step**2, seed=1)
    learned = CUE.learn(maps_of(image, box_of()), box_of())
    view = CUE.observe(maps_of(image, box_of()), box_of())
    blended = template
    for waiting in (1, 2):
        blended = CUE.blend(blended, view, 0.5)
        assert blended.waiting == waiting
        assert blended.weights is template.weights
    blended = CUE.blend(blended, view, 0.5)
    assert blended.waiting == 0
    kept = 0.995**3
    expected = kept * template.weights + (1 - kept) * learned.weights
    np.testing.assert_allclose(blended.weights, expected, atol=1e-6)


def test_an_image_buffer_that_is_overwritten_later_does_no_harm(template):
    buffer = frame()
    learned = CUE.learn(maps_of(buffer, box_of()), box_of())
    waiting = CUE.blend(learned, CUE.observe(maps_of(buffer, box_of()), box_of()), 0.9)
    buffer[:] = 0
    for kept in (learned, waiting):
        np.testing.assert_array_equal(kept.weights, template.weights)
