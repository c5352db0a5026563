"""ViBe compared with its definition, computed pixel by pixel."""

import numpy as np
import pytest

from pf_tracker_ros.background import BackgroundModel


def model_of(image, seed=0, foreground_boxes=(), reduction=1, **settings):
    generator = np.random.default_rng(seed)
    return type("Model", (BackgroundModel,), settings)(
        image, generator, foreground_boxes, reduction=reduction
    )


def noise(shape, seed, low=0, high=256):
    return np.random.default_rng(seed).integers(low, high, shape).astype(np.uint8)


def background_by_definition(samples, pixel, radius, least):
    """Whether enough samples (N, channels) lie around a pixel (channels,)."""
    near = 0
    for sample in samples:
        if max(abs(int(a) - int(b)) for a, b in zip(sample, pixel, strict=True)) <= radius:
            near += 1
    return near >= least


def neighborhood(image, y, x):
    bordered = np.pad(image, [(1, 1), (1, 1)] + [(0, 0)] * (image.ndim - 2), mode="edge")
    patch = bordered[y : y + 3, x : x + 3].reshape(9, -1)
    return {tuple(value) for value in patch}


@pytest.mark.parametrize("shape", [(6, 5), (6, 5, 3)])
def test_the_first_samples_are_all_values_of_each_pixel_s_neighborhood(shape):
    image = noise(shape, seed=1)
    samples = model_of(image, sample_count=100).samples
    for y in range(6):
        for x in range(5):
            drawn = {tuple(value) for value in samples[:, :, y, x]}
            # 100 draws miss one of nine values once in 130 000 times.
            assert drawn == neighborhood(image, y, x)


@pytest.mark.parametrize("shape", [(9, 8), (9, 8, 3)])
@pytest.mark.parametrize(("radius", "least"), [(20, 2), (0, 1), (60, 5), (254, 20)])
def test_a_pixel_with_too_few_near_samples_is_foreground(shape, radius, least):
    first, second = noise(shape, seed=2, low=60, high=180), noise(shape, seed=3, low=40, high=200)
    model = model_of(first, radius=radius, matches=least)
    samples = model.samples
    mask = model.update(second)
    assert mask.dtype == np.uint8
    for y in range(9):
        for x in range(8):
            background = background_by_definition(
                samples[:, :, y, x], np.atleast_1d(second[y, x]), radius, least
            )
            assert mask[y, x] == (0 if background else 255)


def test_a_difference_of_exactly_the_radius_still_matches():
    model = model_of(np.full((4, 4), 100, np.uint8), radius=20, update_every=10_000)
    assert not model.update(np.full((4, 4), 120, np.uint8)).any()
    assert model.update(np.full((4, 4), 121, np.uint8)).all()
    assert not model.update(np.full((4, 4), 80, np.uint8)).any()
    assert model.update(np.full((4, 4), 79, np.uint8)).all()


def test_only_background_updates_its_samples_and_its_neighbors():
    # Every background pixel updates in every frame; the middle of the image is foreground.
    model = model_of(np.full((7, 7), 100, np.uint8), update_every=1)
    image = np.full((7, 7), 110, np.uint8)
    image[2:5, 2:5] = 200
    mask = model.update(image)
    np.testing.assert_array_equal(mask == 255, image == 200)
    samples = model.samples[:, 0]
    assert set(np.unique(samples)) == {100, 110}
    replaced = (samples == 110).sum(axis=0)
    assert (replaced[mask == 0] >= 1).all()
    # Two samples at most a frame and pixel come from itself and chance, the rest from neighbors.
    assert replaced.sum() <= 2 * np.count_nonzero(mask == 0)
    assert replaced[3, 3] == 0


def test_background_spreads_into_wrong_foreground():
    # A ghost: the object of the first frame has left; the ground behind it looks like the rest.
    first = np.full((24, 24), 50, np.uint8)
    first[10:14, 10:14] = 200
    model = model_of(first, update_every=2)
    empty = np.full((24, 24), 50, np.uint8)
    assert model.update(empty)[10:14, 10:14].any()
    for _ in range(100):
        mask = model.update(empty)
    assert not mask.any()


def test_samples_are_replaced_as_often_as_declared():
    # Each pixel replaces one sample with a chance of 1/16 and one of a neighbor's with the same, so
    # 1/8 of the pixels have one more sample of value 110; few have two in the same place.
    model = model_of(np.full((200, 200), 100, np.uint8), sample_count=100)
    model.update(np.full((200, 200), 110, np.uint8))
    replaced = np.count_nonzero(model.samples == 110)
    assert replaced == pytest.approx(200 * 200 / 8, rel=0.06)


def test_every_sample_and_every_pixel_has_the_same_chance():
    model = model_of(np.full((30, 30), 100, np.uint8), update_every=4)
    # All values are within the radius of each other, so all stays background.
    counts = np.zeros((20, 30, 30))
    for step in range(200):
        value = 100 + step % 2
        before = model.samples[:, 0]
        model.update(np.full((30, 30), value, np.uint8))
        counts += (model.samples[:, 0] != before) if step else 0
    per_sample = counts.sum(axis=(1, 2))
    np.testing.assert_allclose(per_sample, per_sample.mean(), rtol=0.1)
    inner = counts.sum(axis=0)[2:-2, 2:-2]
    assert inner.std() < 3 * np.sqrt(inner.mean())


def test_the_same_seed_gives_the_same_bits():
    frames = [noise((40, 50, 3), seed, high=120) for seed in range(5)]
    one, other = (model_of(frames[0], seed=9, reduction=2) for _ in range(2))
    for frame in frames[1:]:
        np.testing.assert_array_equal(one.update(frame), other.update(frame))
    np.testing.assert_array_equal(one.samples, other.samples)


@pytest.mark.parametrize("size", [(48, 64), (47, 63)])
def test_the_mask_has_the_model_s_size(size):
    model = model_of(np.full((*size, 3), 80, np.uint8), reduction=4)
    image = np.full((*size, 3), 80, np.uint8)
    image[16:32, 16:40] = 220
    mask = model.update(image)
    assert mask.shape == (12, 16)
    expected = np.zeros((12, 16), bool)
    expected[4:8, 4:10] = True
    if size == (48, 64):
        np.testing.assert_array_equal(mask == 255, expected)
    assert mask[5:7, 5:9].all()


def test_several_targets_leave_no_ghosts():
    """Partly outside, adjacent and overlapping."""
    empty = np.full((60, 60), 90, np.uint8)
    first = empty.copy()
    foreground_boxes = [(-6.0, 4.0, 16.0, 9.0), (30.0, 20.0, 8.0, 20.0), (34.0, 30.0, 12.0, 12.0)]
    foreground_boxes += [(52.5, 50.5, 20.0, 30.0)]
    for x, y, width, height in np.array(foreground_boxes, int):
        first[max(y, 0) : y + height, max(x, 0) : x + width] = 200
    assert model_of(first).update(empty).any()
    model = model_of(first, foreground_boxes=foreground_boxes)
    assert not model.update(empty).any()
    np.testing.assert_array_equal(model.update(first) == 255, first == 200)


def test_when_most_of_the_image_stays_changed_it_initializes_again_without_the_targets():
    model = model_of(np.full((40, 40), 90, np.uint8), update_every=3)
    bright = np.full((40, 40), 200, np.uint8)
    bright[4:10, 6:12] = bright[20:30, 25:35] = 120
    foreground_boxes = [(6.0, 4.0, 6.0, 6.0), (25.0, 20.0, 10.0, 10.0)]
    for _ in range(3):
        assert model.update(bright, foreground_boxes).mean() > 250
        assert str(model.state).startswith("off: most of the image has changed")
    mask = model.update(bright)
    assert model.state.name == "learning"
    np.testing.assert_array_equal(mask == 255, bright == 120)


def test_the_defaults():
    """20 color samples of a half-size image, which match within 20 gray levels."""
    image = np.full((40, 40, 3), 100, np.uint8)
    model = BackgroundModel(image, np.random.default_rng(0))
    assert model.reduction == 2
    assert model.samples.shape == (20, 3, 20, 20)
    assert not model.update(image + np.uint8(20)).any()
    assert model.update(image + np.uint8(41)).all()
    states = []
    for _ in range(15):
        model.update(image)
        states.append(model.state.name)
    assert states == ["learning"] * 13 + ["ready"] * 2


def test_half_of_the_image_may_be_foreground():
    image = np.full((20, 20), 90, np.uint8)
    model = model_of(image, update_every=4)
    states = [model.state.name]
    for _ in range(5):
        model.update(image)
        states.append(model.state.name)
    assert states == ["learning"] * 4 + ["ready"] * 2
    model = model_of(image)
    image[:10] = 200
    model.update(image)
    assert model.state.name == "learning"
    image[10, 0] = 200
    model.update(image)
    assert model.state.name == "off"


@pytest.mark.parametrize(
    ("size", "reduction"), [((480, 640), 2), ((1080, 1920), 2), ((2160, 3840), 4), ((40, 60), 2)]
)
def test_the_model_of_a_large_image_is_limited(size, reduction):
    model = model_of(np.zeros(size, np.uint8), reduction=2)
    assert model.reduction == reduction
    assert model.samples.shape[2:] == tuple(-(-side // reduction) for side in size)
