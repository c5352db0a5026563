"""The color contrast cue: colors that the target has and its surroundings do not."""

import numpy as np
import pytest

from pf_tracker_ros.cues.color_contrast import ColorContrast, ColorContrastParameters
from pf_tracker_ros.frames import Frame, Region

BOX = np.array([40.0, 30.0, 20.0, 20.0])
CUE = ColorContrast(ColorContrastParameters(), ring=0.5, sharpness=10.0)


def region_of(image, *boxes):
    return Region(Frame(image), np.array(boxes), context_margin=CUE.context_margin)


@pytest.fixture
def image():
    """A red square on blue ground; green bars across both."""
    image = np.zeros((90, 120, 3), np.uint8)
    image[..., 0] = 200
    image[30:50, 40:60] = (0, 0, 200)
    image[38:42] = (0, 200, 0)
    return image


def test_probabilities_by_hand(image):
    template = CUE.learn(region_of(image, BOX), BOX)
    levels = 16
    red, green, blue = 12 * levels**2, 12 * levels, 12
    # Inside: 4 of 20 rows are green, the rest red. The ring is 40 x 40 less the box.
    assert template.inside[green] == pytest.approx(0.2)
    assert template.inside[red] == pytest.approx(0.8)
    ring_green = 4 * 20 / (40 * 40 - 20 * 20)
    assert template.ring[green] == pytest.approx(ring_green)
    probabilities = template.probabilities
    assert probabilities[red] == pytest.approx(1.0, abs=1e-3)
    assert probabilities[blue] == pytest.approx(0.0, abs=1e-3)
    assert probabilities[green] == pytest.approx(0.2 / (0.2 + ring_green), abs=1e-3)
    # An unseen color has probability 1/2.
    assert probabilities[5] == pytest.approx(0.5)


def test_the_target_s_own_position_has_the_highest_contrast(image):
    template = CUE.learn(region_of(image, BOX), BOX)
    others = [BOX + shift for shift in ([5, 0, 0, 0], [0, -5, 0, 0], [20, 0, 0, 0])]
    region = Region(
        Frame(image), np.array([BOX, *others]), context_margin=CUE.context_margin, center_box=BOX
    )
    contrasts = CUE.response(region, np.array([BOX, *others]), template)
    assert contrasts.argmax() == 0
    assert contrasts[0] == pytest.approx(template.contrast, abs=1e-6)


@pytest.mark.parametrize("reduction", [1, 2])
def test_contrast_equals_a_loop_over_pixels(reduction):
    """At whole pixels; between them it is interpolated. Outside the image, P is 0."""
    generator = np.random.default_rng(0)
    image = np.repeat(np.repeat(generator.integers(0, 4, (45, 60, 3), np.uint8) * 60, 2, 0), 2, 1)
    center_box = np.array([50.0, 40.0, 24.0, 16.0])
    boxes = np.tile(center_box, (20, 1))
    boxes[:, :2] = 2 * generator.integers(-4, 36, (20, 2))
    region = Region(
        Frame(image), boxes, reduction, context_margin=CUE.context_margin, center_box=center_box
    )
    template = CUE.learn(region, center_box)
    steps = image[::reduction, ::reduction].astype(int) * 16 // 256
    target = template.probabilities[steps[..., 2] * 256 + steps[..., 1] * 16 + steps[..., 0]]
    target = np.pad(target, 120 // reduction)
    expected = []
    for x, y, width, height in ((boxes + [120, 120, 0, 0]) / reduction).astype(int):
        whole = target[y - height // 2 : y + 3 * height // 2, x - width // 2 : x + 3 * width // 2]
        inside = target[y : y + height, x : x + width]
        ring = (whole.sum() - inside.sum()) / (whole.size - inside.size)
        expected.append(inside.mean() - ring)
    np.testing.assert_allclose(CUE.response(region, boxes, template), expected, atol=1e-6)
    between = (boxes[:-1] + boxes[1:]) / 2
    shift = np.array([0.5 * reduction, 0.0, 0.0, 0.0])
    pair = [CUE.response(region, between[:1] + k * shift, template)[0] for k in (0, 1, 2)]
    if between[0, 0] % reduction == 0:
        assert pair[1] == pytest.approx((pair[0] + pair[2]) / 2, abs=1e-5)


def test_the_largest_number_of_particles_is_read(image):
    few = np.array([BOX, BOX + [5, 0, 0, 0]])
    region = region_of(image, *few)
    template = CUE.learn(region, BOX)
    many = CUE.response(region, np.resize(few, (100_000, 4)), template)
    np.testing.assert_array_equal(many, np.resize(CUE.response(region, few, template), 100_000))


def test_likelihood_and_match_by_hand(image):
    boxes = np.array([BOX, BOX + [20, 0, 0, 0]])
    region = region_of(image, *boxes)
    template = CUE.learn(region, BOX)
    contrasts = CUE.response(region, boxes, template)
    expected = -10.0 * (template.contrast - contrasts[1])
    log_likelihood = CUE.log_likelihood(region, boxes, template)
    np.testing.assert_allclose(log_likelihood, [0.0, expected], atol=1e-5)
    for box, log, contrast in zip(boxes, log_likelihood, contrasts, strict=True):
        match = CUE.match(CUE.learn(region, box), template)
        assert match.log_likelihood == pytest.approx(log, abs=1e-5)
        share = min(max(contrast / template.contrast, 0.0), 1.0)
        assert match.similarity == pytest.approx(share, abs=1e-5)


def test_all_boxes_are_read_in_the_size_of_the_center_box(image):
    """A box of any size has the response of the center box's size."""
    cue = ColorContrast(ColorContrastParameters())
    assert cue.uses_center_box_size
    around = np.array([BOX + [shift, 0, 0, 0] for shift in (-6, 0, 4)])
    region = Region(
        Frame(image),
        around + [-10, -10, 20, 20],
        context_margin=cue.context_margin,
        center_box=BOX,
    )
    template = cue.learn(region, BOX)
    expected = cue.response(region, around, template)
    for growth in (-6, 0, 3, 8):
        boxes = around + np.array([-growth, -growth, 2 * growth, 2 * growth])
        np.testing.assert_allclose(cue.response(region, boxes, template), expected)
        # The region covers that size around the smallest boxes too.
        narrow = Region(Frame(image), boxes, context_margin=cue.context_margin, center_box=BOX)
        np.testing.assert_allclose(cue.response(narrow, boxes, template), expected, atol=1e-6)


def test_a_target_like_its_surroundings_has_no_contrast():
    image = np.full((90, 120, 3), 90, np.uint8)
    boxes = np.array([BOX, BOX + [10, 10, 0, 0]])
    region = region_of(image, *boxes)
    template = CUE.learn(region, BOX)
    np.testing.assert_allclose(CUE.log_likelihood(region, boxes, template), 0.0, atol=1e-6)
    assert CUE.match(template, template).similarity == 1.0


def test_boxes_at_the_edge_of_the_image_are_learned_and_scored(image):
    boxes = np.array([[-8.0, 30.0, 20.0, 20.0], [110.0, 80.0, 20.0, 20.0]])
    region = region_of(image, *boxes)
    template = CUE.learn(region, boxes[0])
    assert template.inside.sum() == pytest.approx(1.0)
    assert template.ring.sum() == pytest.approx(1.0)
    assert np.isfinite(CUE.log_likelihood(region, boxes, template)).all()


def test_blend_by_hand(image):
    cue = ColorContrast(ColorContrastParameters(), keep=0.75)
    template = cue.learn(region_of(image, BOX), BOX)
    observation = cue.learn(region_of(255 - image, BOX), BOX)
    blended = cue.blend(template, observation)
    np.testing.assert_allclose(
        blended.ring, 0.75 * template.ring + 0.25 * observation.ring, atol=1e-6
    )
    np.testing.assert_allclose(
        blended.inside, 0.75 * template.inside + 0.25 * observation.inside, atol=1e-6
    )


def test_it_is_not_discriminative():
    """Objects of the target's colors have its contrast."""
    assert not CUE.is_discriminative
