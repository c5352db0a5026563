"""The channels of a window, compared with a loop over pixels and by hand."""

import cv2
import numpy as np
import pytest
from common import grain

from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors

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
STRIDE = GradientsAndColors.cell_size


def extract(window):
    return GradientsAndColors().extract(window[None])[0]


def texture(seed, size=64):
    """Smooth noise with values from 40 to 140."""
    return grain(seed, size, size, 40, 140, scale=2.0, channels=1)[..., 0]


def gradients(gray):
    """The gradient channels alone."""
    return extract(gray)[:11]


def of_cells(channels):
    """(channels, cells) of (channels, rows, columns)."""
    return channels.reshape(len(channels), -1).astype(float)


def distances(points):
    """(N, N) between (D, N) points."""
    return np.linalg.norm(points[:, :, None] - points[:, None], axis=0)


def looped_gradients(gray):
    """Felzenszwalb et al. 2010, section 6, unsigned, pixel by pixel and cell by cell."""
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


@pytest.mark.parametrize("shape", [(32, 32, 3), (32, 32)])
def test_eleven_channels_of_gradients_and_five_of_colors_or_gray_levels(shape):
    window = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    features = extract(window)
    assert features.shape == (16, 32 // STRIDE, 32 // STRIDE)
    assert features.dtype == np.float32
    gray = window if window.ndim == 2 else cv2.cvtColor(window, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(features[:11], gradients(gray))


@pytest.mark.parametrize("contrast", [2, 30, 255])
def test_gradient_channels_are_a_projection_of_those_of_a_loop_over_pixels(contrast):
    """Inner products equal those of the 13, except for the textures' diagonal difference."""
    generator = np.random.default_rng(contrast)
    gray = generator.integers(0, contrast + 1, (24, 24), dtype=np.uint8)
    reduced, looped = of_cells(gradients(gray)), of_cells(looped_gradients(gray))
    dropped = np.array([0.5, -0.5, -0.5, 0.5]) @ looped[9:]
    expected = looped.T @ looped - np.outer(dropped, dropped)
    np.testing.assert_allclose(reduced.T @ reduced, expected, atol=1e-5)


@pytest.mark.parametrize("colors", [(3,), ()], ids=["colored", "gray"])
def test_windows_extracted_together_equal_each_alone(colors):
    windows = np.random.default_rng(0).integers(0, 256, (3, 32, 32, *colors), dtype=np.uint8)
    windows[1] //= 4
    together = GradientsAndColors().extract(windows)
    assert together.shape == (3, 16, 8, 8)
    np.testing.assert_array_equal(together, np.stack([extract(window) for window in windows]))


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


def color_channels(color):
    """The color channels of a uniform patch of a (red, green, blue) color."""
    window = np.empty((4, 4, 3), np.uint8)
    window[:] = color[::-1]
    return extract(window)[11:, 0, 0].astype(float)


@pytest.mark.parametrize("name", NAMED_COLORS)
def test_a_shade_of_a_named_color_is_nearest_to_it(name):
    toward = np.array([128, 128, 128]) - NAMED_COLORS[name]
    shade = (NAMED_COLORS[name] + np.clip(toward, -12, 12)).astype(np.uint8)
    apart = {
        other: np.linalg.norm(color_channels(shade) - color_channels(color))
        for other, color in NAMED_COLORS.items()
    }
    assert min(apart, key=apart.get) == name


def test_distances_of_colors_are_those_of_their_name_probabilities():
    """For common colors almost as with one channel per name; never more."""
    colors = np.random.default_rng(0).integers(40, 216, (300, 3))
    # The centers of the color levels.
    colors = (colors // 8 * 8 + 4).astype(np.uint8)

    def lab(values):
        pixels = np.asarray(values, np.float32)[None] / 255
        return cv2.cvtColor(pixels, cv2.COLOR_RGB2Lab)[0].astype(float)

    common = np.linalg.norm(lab(colors)[:, 1:], axis=1) < 25
    colors = colors[common]
    assert len(colors) > 50
    apart = np.linalg.norm(lab(colors)[:, None] - lab([*NAMED_COLORS.values()]), axis=2)
    fit = np.exp(-0.5 * (apart / 22) ** 2)
    full = distances(0.6 * (fit / fit.sum(axis=1, keepdims=True)).T)
    reduced = distances(np.stack([color_channels(color) for color in colors], axis=1))
    assert (reduced < full + 1e-3).all()
    assert np.square(reduced).sum() > 0.97 * np.square(full).sum()


def test_the_names_of_a_cell_are_the_means_of_its_parts():
    """Names are computed for quarters of a cell, 2 x 2 pixels."""
    generator = np.random.default_rng(0)
    quarters = generator.integers(0, 256, (4, 4, 3), dtype=np.uint8)
    window = np.kron(quarters, np.ones((2, 2, 1), np.uint8))
    channels = extract(window)[11:]
    for i, j in np.ndindex(2, 2):
        parts = []
        for color in quarters[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].reshape(-1, 3):
            parts.append(extract(np.full((4, 4, 3), color, np.uint8))[11:, 0, 0])
        np.testing.assert_allclose(channels[:, i, j], np.mean(parts, axis=0), atol=1e-6)


def strips(values):
    """A gray window of 8 x 8 cells, each column of cells with one value."""
    return np.repeat(np.array(values, np.uint8), STRIDE)[None].repeat(8 * STRIDE, axis=0)


def test_gray_levels_span_the_range_of_the_window_s_middle():
    """The middle four columns are 40 to 240, so a level is 40 wide; values beyond are clipped."""
    levels = extract(strips([0, 40, 40, 90, 140, 240, 200, 255]))[11:]
    expected = np.zeros((6, 8))
    for column, shares in enumerate(
        ({0: 1}, {0: 1}, {0: 1}, {1: 0.75, 2: 0.25}, {2: 0.5, 3: 0.5}, {5: 1}, {4: 1}, {5: 1})
    ):
        for level, share in shares.items():
            expected[level, column] = 0.6 * share
    np.testing.assert_allclose(distances(levels[:, 3]), distances(expected), atol=0.01)
    np.testing.assert_array_equal(levels, levels[:, :1].repeat(8, axis=1))


def test_a_few_pixels_do_not_stretch_the_gray_levels():
    window = np.random.default_rng(0).integers(100, 140, (64, 64), dtype=np.uint8)
    levels = extract(window)[11:]
    hot = window.copy()
    hot[20:22, 20:22] = 255
    same = np.abs(extract(hot)[11:] - levels).max(axis=0) < 0.1
    assert (~same).sum() == 1


def test_brightness_and_contrast_do_not_change_the_gray_levels():
    cells = 2 * np.random.default_rng(0).integers(5, 45, (16, 16), dtype=np.uint8)
    window = np.kron(cells, np.ones((STRIDE, STRIDE), np.uint8))
    levels = extract(window)[11:]
    for other in (window + 100, window // 2 + 7, 2 * window):
        np.testing.assert_allclose(extract(other)[11:], levels, atol=0.01)


def test_noise_of_the_sensor_alone_hardly_has_gray_levels():
    """The range is at least 16 gray levels, so 2 of these are 5 / 8 of one level."""
    window = np.full((64, 64), 100, np.uint8)
    window[:, 32:] = 102
    levels = extract(window)[11:]
    assert np.ptp(levels, axis=(1, 2)).max() > 0.0
    apart = np.linalg.norm(levels[:, 0, 0] - levels[:, 0, -1])
    assert apart == pytest.approx(0.6 * 5 / 8 * np.sqrt(2), abs=0.01)
