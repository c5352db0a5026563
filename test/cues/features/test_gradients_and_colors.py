"""What a window's cells hold, against a loop over pixels and by hand."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors

# Alphabetical: the order of the channels.
NAMED_COLORS = {
    "black": (0, 0, 0),
    "blue": (0, 0, 255),
    "brown": (139, 69, 19),
    "gray": (128, 128, 128),
    "green": (0, 160, 0),
    "orange": (255, 140, 0),
    "pink": (255, 150, 190),
    "purple": (130, 0, 150),
    "red": (220, 0, 0),
    "white": (255, 255, 255),
    "yellow": (255, 230, 0),
}
STRIDE = GradientsAndColors.stride


def extract(window):
    return GradientsAndColors().extract(window)


def texture(seed, size=64):
    """Smooth noise with values from 40 to 140."""
    noise = np.random.default_rng(seed).normal(size=(size, size))
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 40, 140, cv2.NORM_MINMAX)


def gradients(gray):
    """The gradient channels alone."""
    return extract(gray)[:13]


def looped_gradients(gray):
    """Felzenszwalb et al. 2010, section 6, without signs, pixel by pixel and cell by cell."""
    rows, columns = gray.shape[0] // 4, gray.shape[1] // 4
    padded = np.pad(gray.astype(float), 1, mode="reflect")
    histogram = np.zeros((rows, columns, 9))
    for y in range(gray.shape[0]):
        for x in range(gray.shape[1]):
            right = padded[y + 1, x + 2] - padded[y + 1, x]
            down = padded[y + 2, x + 1] - padded[y, x + 1]
            direction = np.degrees(np.arctan2(down, right)) % 180
            for number in range(9):
                apart = abs((direction - 20 * number + 90) % 180 - 90) / 20
                share = max(1 - apart, 0.0)
                histogram[y // 4, x // 4, number] += share * np.hypot(right, down) / 16
    energy = np.pad((histogram**2).sum(axis=2), 1, mode="edge")
    channels = np.zeros((13, rows, columns))
    for i in range(rows):
        for j in range(columns):
            corners = [(0, 0), (0, 1), (1, 0), (1, 1)]
            for number, (down, right) in enumerate(corners):
                block = energy[i + down : i + down + 2, j + right : j + right + 2].sum()
                cut = np.minimum(histogram[i, j] / np.sqrt(block + 4.0), 0.2)
                channels[:9, i, j] += cut / 2
                channels[9 + number, i, j] = cut.sum() / np.sqrt(18)
    return channels


@pytest.mark.parametrize(("shape", "channels"), [((32, 32, 3), 24), ((32, 32), 19)])
def test_gradients_and_eleven_colors_or_six_gray_levels(shape, channels):
    window = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    features = extract(window)
    assert features.shape == (channels, 32 // STRIDE, 32 // STRIDE)
    assert features.dtype == np.float32
    gray = window if window.ndim == 2 else cv2.cvtColor(window, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(features[:13], gradients(gray))


@pytest.mark.parametrize("contrast", [2, 30, 255])
def test_gradient_channels_equal_a_loop_over_pixels(contrast):
    generator = np.random.default_rng(contrast)
    gray = generator.integers(0, contrast + 1, (24, 24), dtype=np.uint8)
    np.testing.assert_allclose(gradients(gray), looped_gradients(gray), atol=1e-5)


def test_an_even_window_has_no_gradients():
    for value in (0, 90, 255):
        assert not gradients(np.full((32, 32), value, np.uint8)).any()


def test_brightness_and_contrast_hardly_change_the_gradient_channels():
    image = texture(0)
    features = gradients(image.astype(np.uint8))
    brighter = gradients(image.astype(np.uint8) + np.uint8(80))
    np.testing.assert_array_equal(brighter, features)
    other = np.abs(gradients(texture(1).astype(np.uint8)) - features).mean()
    stronger = gradients(np.rint(1.7 * image).astype(np.uint8))
    assert np.abs(stronger - features).mean() < 0.1 * other


def test_an_edge_counts_for_its_direction_whatever_its_sign():
    rising = np.tile((4 * np.arange(32)).astype(np.uint8), (32, 1))
    for image, directions in ((rising, [0]), (rising[:, ::-1], [0])):
        features = gradients(np.ascontiguousarray(image))[:9, 2:-2, 2:-2]
        held = features.max(axis=(1, 2))
        assert np.flatnonzero(held > 1e-6).tolist() == directions


@pytest.mark.parametrize("name", NAMED_COLORS)
def test_a_patch_of_a_named_color_has_that_name(name):
    window = np.empty((16, 16, 3), np.uint8)
    window[:] = NAMED_COLORS[name][::-1]
    channels = extract(window)[13:]
    number = list(NAMED_COLORS).index(name)
    assert (channels.argmax(axis=0) == number).all()
    np.testing.assert_allclose(channels.sum(axis=0), 0.6, atol=1e-4)


def test_the_names_of_a_cell_are_the_means_of_its_parts():
    """Each quarter of a cell, 2 x 2 pixels, has its names."""
    generator = np.random.default_rng(0)
    quarters = generator.integers(0, 256, (4, 4, 3), dtype=np.uint8)
    window = np.kron(quarters, np.ones((2, 2, 1), np.uint8))
    channels = extract(window)[13:]
    for i, j in np.ndindex(2, 2):
        parts = []
        for color in quarters[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].reshape(-1, 3):
            parts.append(extract(np.full((4, 4, 3), color, np.uint8))[13:, 0, 0])
        np.testing.assert_allclose(channels[:, i, j], np.mean(parts, axis=0), atol=1e-6)


def strips(values):
    """A gray window of 8 cells a side, each column of cells of one value."""
    return np.repeat(np.array(values, np.uint8), STRIDE)[None].repeat(8 * STRIDE, axis=0)


def test_gray_levels_span_what_is_in_the_middle_of_the_window():
    """The middle four columns are 40 to 240, so a level is 40 wide; beyond them it is the end."""
    levels = extract(strips([0, 40, 40, 90, 140, 240, 200, 255]))[13:]
    expected = np.zeros((6, 8))
    for column, shares in enumerate(
        ({0: 1}, {0: 1}, {0: 1}, {1: 0.75, 2: 0.25}, {2: 0.5, 3: 0.5}, {5: 1}, {4: 1}, {5: 1})
    ):
        for level, share in shares.items():
            expected[level, column] = 0.6 * share
    np.testing.assert_allclose(levels, expected[:, None].repeat(8, axis=1), atol=0.006)


def test_a_few_pixels_do_not_stretch_the_gray_levels():
    window = np.random.default_rng(0).integers(100, 140, (64, 64), dtype=np.uint8)
    levels = extract(window)[13:]
    hot = window.copy()
    hot[20:22, 20:22] = 255
    same = np.abs(extract(hot)[13:] - levels).max(axis=0) < 0.1
    assert (~same).sum() == 1


def test_brightness_and_contrast_do_not_change_the_gray_levels():
    cells = 2 * np.random.default_rng(0).integers(5, 45, (16, 16), dtype=np.uint8)
    window = np.kron(cells, np.ones((STRIDE, STRIDE), np.uint8))
    levels = extract(window)[13:]
    for other in (window + 100, window // 2 + 7, 2 * window):
        np.testing.assert_allclose(extract(other)[13:], levels, atol=0.01)


def test_noise_of_the_sensor_alone_hardly_has_gray_levels():
    """Its range counts as 16 gray levels at least, so that 2 of them are less than one level."""
    window = np.random.default_rng(0).integers(100, 103, (64, 64), dtype=np.uint8)
    assert not extract(window)[15:].any()
