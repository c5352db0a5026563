"""The infrared scene: gray, exact ground truth, what settings promise, the same bits."""

import numpy as np
import pytest
from scenes import InfraredScene

PLAIN = {"noise": 0.0, "flip": 0, "halo": 0.0, "shake": 0.0}


def test_same_seed_same_bits_another_seed_another_scene():
    one, same, other = (InfraredScene(seed).render(30) for seed in (3, 3, 4))
    assert one.shape == (480, 640)
    assert one.dtype == np.uint8
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.5


@pytest.mark.parametrize("index", [0, 20, 99])
def test_the_box_holds_the_target_and_little_else(index):
    """What a change of the bodies' warmth changes around the box is the target."""
    warm, cold = (InfraredScene(1, PLAIN | {"contrast": c}) for c in (80.0, 20.0))
    x, y, width, height = warm.target_boxes[index]
    changed = np.abs(warm.render(index).astype(int) - cold.render(index)) > 20
    rows, columns = np.indices(changed.shape)
    near = (columns > x - 6) & (columns < x + width + 6) & (rows > y - 6) & (rows < y + height + 6)
    inside = (columns >= x) & (columns < x + width) & (rows >= y - 1) & (rows < y + height + 1)
    assert changed[inside].mean() > 0.3
    target = changed & near
    assert (target & inside).sum() > 0.9 * target.sum()
    assert np.flatnonzero(target.any(axis=1))[[0, -1]] == pytest.approx([y, y + height], abs=4)


def test_the_target_stays_in_the_image():
    for seed in range(5):
        boxes = InfraredScene(seed).target_boxes
        assert boxes.shape == (100, 4)
        assert (boxes[:, :2] >= 0.0).all()
        assert (boxes[:, :2] + boxes[:, 2:] <= [640.0, 480.0]).all()


def test_polarity_flips_from_the_given_frame_on():
    flipping, plain = (InfraredScene(0, PLAIN | {"flip": flip}) for flip in (50, 0))
    np.testing.assert_array_equal(flipping.render(49), plain.render(49))
    np.testing.assert_array_equal(flipping.render(50), 255 - plain.render(50))


def test_the_halo_is_a_dark_ring_and_leaves_the_rest():
    with_halo, without = (InfraredScene(0, PLAIN | {"halo": halo}) for halo in (1.0, 0.0))
    difference = with_halo.render(10).astype(int) - without.render(10)
    assert difference.min() < -5
    assert difference.max() <= 1
    x, y, width, height = with_halo.target_boxes[10].astype(int)
    middle = difference[y + 30 : y + 40, x + width // 2 - 3 : x + width // 2 + 3]
    assert np.abs(middle).max() <= 1
    assert (difference[: y - 80] == 0).all()
    assert difference[y : y + height, x - 3 : x + width + 3].min() < -5


def test_noise_has_the_declared_spread():
    noisy, plain = (InfraredScene(2, PLAIN | {"noise": noise}) for noise in (6.0, 0.0))
    difference = noisy.render(5).astype(float) - plain.render(5)
    assert difference.std() == pytest.approx(6.0, rel=0.05)


def test_a_wrong_seed_or_setting_is_refused():
    with pytest.raises(ValueError, match="seed is -1"):
        InfraredScene(-1)
    with pytest.raises(ValueError, match="contrast"):
        InfraredScene(0, {"contrast": -1.0})
