"""Gain control: slow for a drift, unchanged by a few bad frames, quick when they last."""

import pickle

import numpy as np
import pytest

from pf_tracker_ros.frames.exposure import GainControl, gray_range, to_8_bit

INTERVAL = 0.04
SIZE = (60, 80)
KINDS = {"16 bit": (np.uint16, 7000.0, 100.0), "32 bit": (np.float32, 290.0, 1.0)}


def scene(kind="16 bit", offset=0.0, seed=0):
    """A scene with values from 0 to 10 units of its kind, plus an offset."""
    dtype, base, unit = KINDS[kind]
    values = np.random.default_rng(seed).uniform(0.0, 10.0, SIZE)
    return (base + unit * (values + offset)).astype(dtype)


def flat(value, kind="16 bit"):
    return np.full(SIZE, value, KINDS[kind][0])


def with_outliers(image, value, share=0.02):
    image = image.copy()
    image.flat[: round(share * image.size)] = value
    return image


def gain_after(images, gain=None, interval=INTERVAL):
    gain = gain or GainControl()
    for image in images:
        gain = gain.update(image, interval)
    return gain


def lasting(image, seconds, interval=INTERVAL):
    return [image] * round(seconds / interval)


def shows(gain, image):
    """Whether an image has at least two thirds of its contrast and is not saturated."""
    own, view = to_8_bit(image, gray_range(image)), to_8_bit(image, gain.span)
    return view.std() > own.std() / 1.5 and np.mean((view > 0) & (view < 255)) > 0.9


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def bad_frames(kind):
    dtype, base, unit = KINDS[kind]
    noise = np.random.default_rng(1).uniform(0.0, 60000.0, SIZE).astype(dtype)
    yield "one value far above", flat(65535, kind)
    yield "zeros", flat(0, kind)
    yield "one value inside", flat(base + 5 * unit, kind)
    yield "outliers", with_outliers(scene(kind), 65535 if kind == "16 bit" else 1e9)
    yield "noise", noise
    yield "a shutter", (base + unit * (4 + 0.1 * noise / 60000)).astype(dtype)
    yield "another scene", scene(kind, offset=60)
    if kind == "32 bit":
        yield "no numbers", flat(np.nan, kind)
        yield "infinite", flat(np.inf, kind)
        yield "half of it infinite", with_outliers(scene(kind), np.inf, share=0.5)
        yield "lower outliers", with_outliers(scene(kind), -1e9)


BAD_FRAMES = [
    pytest.param(kind, image, id=f"{kind}, {name}")
    for kind in KINDS
    for name, image in bad_frames(kind)
]


@pytest.mark.parametrize(("kind", "bad"), BAD_FRAMES)
@pytest.mark.parametrize("count", [1, 5])
def test_few_bad_frames_do_not_change_the_range(kind, bad, count):
    good = scene(kind)
    before = gain_after([good] * 3)
    during = gain_after([bad] * count, before)
    assert during.span == pytest.approx(before.span, rel=1e-3)
    assert gain_after([good], during).span == pytest.approx(before.span, rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "bad"), [case for case in BAD_FRAMES if "outliers" not in case.id]
)
@pytest.mark.parametrize("seconds", [1.0, 5.0])
def test_after_lasting_bad_frames_the_first_good_one_restores_the_range(kind, bad, seconds):
    good = scene(kind)
    before = gain_after([good] * 3)
    after = gain_after([*lasting(bad, seconds), good], before)
    assert after.span == pytest.approx(before.span, rel=1e-2)


@pytest.mark.parametrize(("kind", "bad"), BAD_FRAMES)
@pytest.mark.parametrize("count", [1, 100])
def test_good_frames_after_a_bad_start_are_shown_well_within_a_second(kind, bad, count):
    good = scene(kind)
    gain = gain_after([*[bad] * count, *lasting(good, 0.6)])
    assert shows(gain, good)


def test_bad_frames_between_good_ones_or_that_disagree_do_not_change_the_range(kind):
    good, bad = scene(kind), scene(kind, offset=60)
    before = gain_after([good])
    assert gain_after([bad, good] * 100, before).span == pytest.approx(before.span, rel=1e-6)
    frames = [scene(kind, offset=60 + 40 * (number % 2)) for number in range(100)]
    assert gain_after(frames, before).span == before.span


@pytest.mark.parametrize("interval", [0.01, 0.04, 0.2, 1.0])
def test_lasting_frames_far_outside_make_the_range_jump(kind, interval):
    elsewhere = scene(kind, offset=60)
    gain = gain_after([scene(kind)])
    before, seconds = gain.span, 0.0
    # The first outlier has no duration yet.
    gain = gain.update(elsewhere, interval)
    while gain.span == before:
        gain = gain.update(elsewhere, interval)
        seconds += interval
    assert 0.5 - 1e-9 <= seconds < 0.5 + interval or seconds == interval
    assert gain.span == gray_range(elsewhere)


def test_the_range_recovers_within_a_second_and_moves_to_other_values(kind):
    good = scene(kind)
    bad = with_outliers(good, 65535 if kind == "16 bit" else 1e9)
    assert shows(gain_after([good, *lasting(bad, 20.0), *lasting(good, 0.6)]), good)
    # From values of 0 to 1 to temperatures.
    unit = np.random.default_rng(0).uniform(0.0, 1.0, SIZE).astype(np.float32)
    kelvin = 290 + 10 * unit
    assert shows(gain_after([*lasting(unit, 2.0), *lasting(kelvin, 1.0)]), kelvin)


def test_the_range_of_a_steady_camera_is_that_of_its_images_and_nan_sets_none(kind):
    images = [scene(kind, seed=seed) for seed in range(50)]
    assert gain_after(images).span == pytest.approx(gray_range(images[0]), rel=2e-3)
    if kind == "32 bit":
        assert gain_after([flat(np.nan, kind)] * 3).span is None
        assert gain_after([flat(np.nan, kind), images[0]]).span == gray_range(images[0])


def test_the_range_follows_a_drift_with_the_time_constant_and_without_jumps(kind):
    _, _, unit = KINDS[kind]
    gain = gain_after([scene(kind)])
    spans = []
    for step in range(1500):
        gain = gain.update(scene(kind, offset=0.01 * step), INTERVAL)
        spans.append(gain.span)
    jumps = np.abs(np.diff(spans, axis=0)).max() / unit
    assert jumps < 0.03
    # The lag is the drift, 0.25 units per second, times the time constant of 10 s.
    lag = (np.array(gray_range(scene(kind, offset=14.99))) - spans[-1]) / unit
    assert lag == pytest.approx([2.5, 2.5], abs=0.1)


def test_the_range_adapts_slowly_to_a_hot_object_that_stays_in_view(kind):
    """A target beside it keeps its gray."""
    cool = scene(kind)
    hot = with_outliers(cool, KINDS[kind][1] + 200 * KINDS[kind][2], share=0.1)
    gain = before = gain_after([cool])
    views = []
    for _ in range(50):
        gain = gain.update(hot, INTERVAL)
        views.append(to_8_bit(cool, gain.span).astype(int))
    assert np.abs(np.diff(views, axis=0)).max() <= 20
    assert gain.span[1] > before.span[1] + 10 * KINDS[kind][2]


def test_a_gain_control_is_immutable(kind):
    gain = gain_after([scene(kind), scene(kind, offset=60)])
    twin = pickle.loads(pickle.dumps(gain))
    assert twin == gain
    before = (gain.span, gain.outlier_span, gain.outlier_for)
    gain.update(scene(kind, offset=60), 3.0)
    assert (gain.span, gain.outlier_span, gain.outlier_for) == before
    assert gain_after([scene(kind, offset=60)] * 20, twin).span != gain.span
