"""Training of a correlation filter, compared with dense solutions, and its response."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues import correlation_filter
from pf_tracker_ros.cues.correlation_filter import (
    SquareTransform,
    invert,
    product,
    response,
    response_at_center,
    shifted,
    spectra_of,
    train,
    transform,
)

CELLS = 16
TARGET = (5.0, 3.5)


def noise(seed, channels=4, cells=CELLS, smooth=0.0):
    """Features scaled as by `spectra_of`; smooth ones lack the highest frequencies."""
    features = np.random.default_rng(seed).normal(size=(channels, cells, cells))
    if smooth:
        frequency = np.fft.fftfreq(cells)
        falloff = np.exp(-0.5 * (2 * np.pi * smooth * frequency) ** 2) * (abs(frequency) < 0.4)
        features = np.fft.ifft2(np.fft.fft2(features) * np.outer(falloff, falloff)).real
    return (0.06 * features / features.std()).astype(np.float32)


def half_spectrum(features):
    return np.fft.rfft2(features).astype(np.complex64)


def peak(cells, target):
    """The wanted response at each cyclic displacement."""
    values = np.empty((cells, cells))
    for y, x in np.ndindex(cells, cells):
        squared = min(y, cells - y) ** 2 + min(x, cells - x) ** 2
        values[y, x] = np.exp(-0.5 * squared / (target[0] * target[1] / 16**2))
    return values


def squared_weight(cells, target):
    """w = 1e-3 inside the target, 1e5 outside, interpolated in partly covered cells; squared."""

    def covered(number, side):
        start, end = number - cells / 2, number + 1 - cells / 2
        return max(min(end, side / 2) - max(start, -side / 2), 0.0)

    weights = np.empty((cells, cells))
    for y, x in np.ndindex(cells, cells):
        inside = covered(x, target[0]) * covered(y, target[1])
        weights[y, x] = 1e-3 * inside + 1e5 * (1 - inside)
    return weights**2


def dense_solution(samples, peak_spectrum, pull, total):
    """(x x^H + total I) f = x y + pull, solved for each frequency."""
    channels, cells, _ = samples.shape
    solution = np.empty_like(samples)
    for y, x in np.ndindex(cells, cells):
        sample = samples[:, y, x]
        matrix = np.outer(sample, sample.conj()) + total * np.eye(channels)
        right = sample * peak_spectrum[y, x].conj() + pull[:, y, x]
        solution[:, y, x] = np.linalg.solve(matrix, right)
    return solution


def dense_training(features, target, before, memory, steps=2):
    """ADMM with full spectra; (channels, cells, cells) filters in space."""
    cells = features.shape[-1]
    area = cells**2
    samples = np.fft.fft2(features.astype(float))
    peak_spectrum = np.fft.fft2(peak(cells, target))
    past = memory * np.fft.fft2(before) if before is not None else np.zeros_like(samples)
    memory = memory if before is not None else 0.0
    inside, dual = np.zeros_like(samples), np.zeros_like(samples)
    for step in range(steps):
        penalty = 10.0**step
        pull = area * (past + penalty * inside - dual)
        trained = dense_solution(samples, peak_spectrum, pull, area * (penalty + memory))
        in_space = np.fft.ifft2(penalty * trained + dual).real
        inside = np.fft.fft2(in_space / (squared_weight(cells, target) / area + penalty))
        dual = dual + penalty * (trained - inside)
    return np.fft.ifft2(trained).real


def in_space(filter_spectrum):
    cells = filter_spectrum.shape[1]
    return np.fft.irfft2(filter_spectrum, s=(cells, cells))


@pytest.mark.parametrize("memory", [0.0, 5.0, 300.0])
def test_training_equals_the_dense_alternating_direction_method(memory):
    first, second = noise(0), noise(1)
    before = train(half_spectrum(first), TARGET, None, memory)
    expected = dense_training(first, TARGET, None, memory)
    np.testing.assert_allclose(in_space(before), expected, atol=1e-4 * np.abs(expected).max())
    after = train(half_spectrum(second), TARGET, before, memory)
    expected = dense_training(second, TARGET, in_space(before).astype(float), memory)
    np.testing.assert_allclose(in_space(after), expected, atol=1e-4 * np.abs(expected).max())


def test_the_filter_is_kept_inside_the_target(monkeypatch):
    cells, target = 40, (10.0, 12.0)
    spectrum = half_spectrum(noise(0, 8, cells, smooth=1.0))
    inside = np.zeros((cells, cells), bool)
    inside[14:26, 15:25] = True

    def outside_share():
        energy = np.square(in_space(train(spectrum, target, None, 0.0))).sum(axis=0)
        return energy[~inside].sum() / energy.sum()

    regularized = outside_share()
    monkeypatch.setattr(correlation_filter, "_STEPS", 1)
    assert regularized < 0.1
    assert outside_share() > 0.5


def test_response_equals_a_loop_over_displacements():
    features = noise(0, channels=2)
    trained = train(half_spectrum(noise(1, 2)), TARGET, None, 0.0)
    values = response(trained, half_spectrum(features), CELLS)
    center = response_at_center(trained, half_spectrum(features))
    assert values[8, 8] == pytest.approx(center, rel=1e-4)
    weights = in_space(trained)
    for down, right in [(0, 0), (3, 0), (0, -5), (-8, 7), (2, 2)]:
        moved = np.roll(features, (-down, -right), axis=(1, 2))
        assert values[8 + down, 8 + right] == pytest.approx((weights * moved).sum(), rel=1e-4)


@pytest.mark.parametrize("refinement", [2, 3, 4])
def test_a_refined_response_passes_through_the_values_at_whole_cells(refinement):
    """Including the highest frequencies, and equally along both axes."""
    spectrum = half_spectrum(noise(0))
    trained = train(half_spectrum(noise(1)), TARGET, None, 0.0)
    values = response(trained, spectrum, CELLS)
    refined = response(trained, spectrum, refinement * CELLS)
    places = slice(refinement * CELLS // 2 % refinement, None, refinement)
    np.testing.assert_allclose(refined[places, places], values, atol=1e-5 * np.abs(values).max())
    turned = [np.fft.rfft2(in_space(one).transpose(0, 2, 1)) for one in (trained, spectrum)]
    np.testing.assert_allclose(
        response(*turned, refinement * CELLS), refined.T, atol=1e-5 * np.abs(values).max()
    )


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -2.0), (-8.0, 7.5), (0.5, 2.5), (-1.5, 0.0)])
def test_the_peak_moves_with_the_window_by_cells_and_halves(shift):
    """The shift theorem moves features without the highest frequencies by parts of a cell."""
    features = noise(0, smooth=0.8)
    trained = train(half_spectrum(features), TARGET, None, 0.0)
    down, right = np.fft.fftfreq(CELLS)[:, None], np.fft.fftfreq(CELLS)[None]
    turned = np.exp(-2j * np.pi * (down * shift[1] + right * shift[0]))
    moved = np.fft.ifft2(np.fft.fft2(features) * turned).real
    values = response(trained, half_spectrum(moved), 2 * CELLS)
    row, column = np.unravel_index(values.argmax(), values.shape)
    assert (column - CELLS, row - CELLS) == (2 * shift[0], 2 * shift[1])
    assert values.max() == pytest.approx(response_at_center(trained, half_spectrum(features)))


def test_spectra_have_a_cosine_window_no_mean_and_a_fixed_scale():
    features = cv2.GaussianBlur(noise(0, 1)[0], (3, 3), 0)[None]
    one, other = spectra_of(np.stack([features, 70 * features + 9]))
    np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-4)
    values = in_space(one)
    assert np.sqrt(np.square(values).mean()) == pytest.approx(0.294, rel=1e-4)
    hann = [np.sin(np.pi * (place + 1) / (CELLS + 1)) ** 2 for place in range(CELLS)]
    window = np.outer(hann, hann)
    expected = (features[0] - np.average(features[0], weights=window)) * window
    expected *= 0.294 / np.sqrt(np.square(expected).mean())
    np.testing.assert_allclose(values[0], expected, atol=1e-5)


def test_the_scale_is_that_of_all_channels_together():
    """Zero or rotated channels have no effect."""
    features = cv2.GaussianBlur(noise(0, 1)[0], (3, 3), 0)
    turned = np.stack([0.6 * features, -0.8 * features, 0 * features])
    power = np.square(np.abs(spectra_of(turned[None])[0])).sum(axis=0)
    np.testing.assert_allclose(
        power, np.square(np.abs(spectra_of(features[None, None])[0, 0])), rtol=1e-3
    )


def test_zero_features_have_a_zero_spectrum():
    assert not spectra_of(np.zeros((2, 3, CELLS, CELLS), np.float32)).any()


def test_features_without_contrast_have_a_zero_spectrum_whatever_is_rounded():
    """Values that no sum represents exactly; the last bits differ between processors."""
    random = np.random.default_rng(3)
    levels = random.random((2, 3, 1, 1)) + 0.1
    flat = np.broadcast_to(levels, (2, 3, CELLS, CELLS)).astype(np.float32)
    last_bits = np.spacing(flat) * random.integers(0, 2, flat.shape).astype(np.float32)
    for features in (flat, flat + last_bits):
        assert not spectra_of(features).any()
    faint = flat.copy()
    faint[:, 0, :, CELLS // 2 :] *= 1.01
    assert (np.abs(spectra_of(faint)).max(axis=(1, 2, 3)) > 0.1).all()


@pytest.mark.parametrize("shift", [(3, 0), (0, -2), (-1, 4)])
def test_a_shifted_spectrum_is_that_of_the_moved_window(shift):
    features = np.random.default_rng(4).standard_normal((2, 16, 16)).astype(np.float32)
    moved = invert(shifted(transform(16).apply(features), np.array(shift, float)))
    expected = np.roll(features, (-shift[1], -shift[0]), axis=(1, 2))
    np.testing.assert_allclose(moved, expected, atol=1e-5)


# Transforms of small squares, and products in blocks


def squares(n, *many):
    return np.random.default_rng(n).normal(size=(*many, n, n)).astype(np.float32)


@pytest.mark.parametrize("n", [2, 8, 24, 40, 64])
@pytest.mark.parametrize("many", [(), (3,), (2, 3)])
def test_a_transform_equals_the_fft(n, many):
    values = squares(n, *many)
    spectra = transform(n).apply(values)
    assert spectra.dtype == np.complex64
    np.testing.assert_allclose(spectra, np.fft.rfft2(values), atol=1e-5 * n)


@pytest.mark.parametrize("n", [2, 8, 24, 40, 64])
def test_the_inverse_gives_the_squares_back(n):
    values = squares(n, 5)
    back = invert(np.fft.rfft2(values).astype(np.complex64))
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, values, atol=1e-5)


def test_the_matrix_is_applied_to_rows_and_columns_first():
    matrix = np.random.default_rng(1).normal(size=(8, 8))
    values = squares(8, 2)
    expected = np.fft.rfft2(matrix @ values @ matrix.T)
    spectra = SquareTransform(matrix).apply(values)
    np.testing.assert_allclose(spectra, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("rows", "inner", "columns"),
    [
        (3, 4, 5),  # one block
        (17, 1984, 17),  # blocks of 7: the last is a part
        (64, 512, 24),  # blocks of 8, all whole
        (300, 1000, 3),  # a column is more than a block
    ],
)
def test_equals_the_product_in_one_piece(rows, inner, columns):
    generator = np.random.default_rng(0)
    matrix = generator.normal(size=(rows, inner)).astype(np.float32)
    other = generator.normal(size=(columns, inner)).astype(np.float32)
    result = product(matrix, other.T)
    assert result.shape == (rows, columns)
    assert result.dtype == np.float32
    expected = matrix.astype(float) @ other.T.astype(float)
    np.testing.assert_allclose(result, expected, atol=1e-5 * inner)
