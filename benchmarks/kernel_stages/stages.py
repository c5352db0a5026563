"""Timings of every map, every cue's scoring and every preset's update."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from kernel_stages.setting import Setting
from kernel_stages.timing import Timed
from pf_tracker_ros import Tracker
from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.cues.correlation_filter import response, spectra_of, train
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.frames import Foreground
from pf_tracker_ros.frames.exposure import gray_range, to_8_bit
from pf_tracker_ros.frames.region import read_window
from pf_tracker_ros.tracking.presets import SELF_CONTAINED

# As the correlation response of `default` looks at a target.
_WINDOW, _CELLS, _PIXELS, _WINDOWS, _SAMPLES = 4.0, 40, 160, 2, 80
_LEVELS, _DIRECTIONS = 16, 8
_WARM_UP = 30
_FEATURES = FEATURES["gradients_and_colors"]()


class Stage(NamedTuple):
    """One stage of a frame.

    Attributes:
        make: What is timed, for a setting.
        pixels: What it reads of the image, whose floor is to read it once; None where the floor is
            one gather for all particles.
    """

    make: Callable[[Setting], Timed]
    pixels: Callable[[Setting], NDArray[np.generic]] | None = None


def floor(stage: Stage, setting: Setting) -> Timed:
    """The least that a stage could take: its pixels read once, or one number for each particle."""
    if stage.pixels is not None:
        pixels = stage.pixels(setting)
        return Timed(lambda _: cv2.norm(pixels, cv2.NORM_L1))
    values = np.zeros(setting.size[0] * setting.size[1], np.int32)
    corners = setting.boxes[:, :2].clip(0, np.array(setting.size) - 1).astype(np.intp)
    places = corners[:, 1] * setting.size[0] + corners[:, 0]
    return Timed(lambda _: values.take(places))


def _region_pixels(setting: Setting) -> NDArray[np.generic]:
    return setting.region().pixels


def _window_pixels(setting: Setting) -> NDArray[np.generic]:
    return _around(setting, _WINDOW)


def _image_pixels(setting: Setting) -> NDArray[np.generic]:
    return setting.image


def _around(setting: Setting, factor: float) -> NDArray[np.generic]:
    """What is around the target, of so many box sizes."""
    center, half = setting.box[:2] + setting.box[2:] / 2, factor * setting.side / 2
    left, top = np.maximum(center - half, 0).astype(int)
    right, bottom = (center + half).astype(int)
    return setting.image[top:bottom, left:right]


def _window(setting: Setting) -> NDArray[np.uint8]:
    center = setting.box[:2] + setting.box[2:] / 2
    return read_window(setting.frame(), center, _WINDOW * setting.side, _PIXELS)


def _resampling(setting: Setting) -> Timed:
    center = setting.box[:2] + setting.box[2:] / 2
    side = _WINDOW * setting.side
    return Timed(lambda frame: read_window(frame, center, side, _PIXELS), setting.frame)


def _features(setting: Setting) -> Timed:
    windows = _window(setting)[None]
    return Timed(lambda _: _FEATURES.extract(windows))


def _spectrum(setting: Setting) -> Timed:
    features = _FEATURES.extract(_window(setting)[None])
    return Timed(lambda _: spectra_of(features))


def _response(setting: Setting) -> Timed:
    (seen,) = spectra_of(_FEATURES.extract(_window(setting)[None]))
    trained = train(seen, (_CELLS / _WINDOW,) * 2, None, 0.0)
    windows = np.stack([seen] * _WINDOWS)
    return Timed(lambda _: response(trained, windows, _SAMPLES))


def _training(setting: Setting) -> Timed:
    (seen,) = spectra_of(_FEATURES.extract(_window(setting)[None]))
    cells = (_CELLS / _WINDOW,) * 2
    before = train(seen, cells, None, 0.0)
    return Timed(lambda _: train(seen, cells, before, 100.0))


def _conversion(setting: Setting) -> Timed:
    deep = replace(setting, kind="16 bit")
    pixels, span = _around(deep, _WINDOW), deep.span
    return Timed(lambda _: to_8_bit(pixels, span))


def _deep_pixels(setting: Setting) -> NDArray[np.generic]:
    return _around(replace(setting, kind="16 bit"), _WINDOW)


def _range(setting: Setting) -> Timed:
    image = replace(setting, kind="16 bit").image
    return Timed(lambda _: gray_range(image))


def _background(setting: Setting) -> Timed:
    image = setting.frame().pixels
    model = BackgroundModel(image, np.random.default_rng(0))
    return Timed(lambda _: model.update(image))


def _cue(name: str) -> object:
    return CUES[name](CUES.parameters_of(name)())


def _color_table(setting: Setting) -> Timed:
    """What a template is made ready with, for all colors."""
    cue, region = _cue("color_contrast"), setting.region(0.4)
    template = cue.learn(region, setting.box)
    return Timed(lambda fresh: fresh.probabilities, lambda: replace(template))


def _scoring(name: str, setting: Setting, *, maps: bool) -> Timed:
    """A cue's log likelihoods of all particles.

    Args:
        name: Of the cue.
        setting: To work on.
        maps: Whether what it is to read of the frame is yet to be computed, for a single particle:
            then that is what is timed.
    """
    cue = _cue(name)

    def region() -> object:
        made = setting.region(cue.context_margin)
        if cue.needs_foreground:
            width, height = (-(-side // 2) for side in setting.size)
            mask = np.zeros((height, width), np.uint8)
            mask[height // 3 : 2 * height // 3] = 255
            made.frame.foreground = Foreground(mask, 2)
        return made

    template = cue.learn(region(), setting.box)
    if maps:
        one = setting.box[None]
        return Timed(lambda fresh: cue.log_likelihood(fresh, one, template), region)
    ready = region()
    return Timed(lambda _: cue.log_likelihood(ready, setting.boxes, template))


def update(preset: str, setting: Setting, **parameters: object) -> Timed:
    """An update of a preset, past the frames in which the target is learned anew each time.

    Args:
        preset: A key of `PRESETS`.
        setting: Its image stands still.
        parameters: Of the tracker, over the preset's.
    """
    values = {"track.wrong_box_cost": 0.0, **parameters}
    tracker = Tracker.from_preset(preset, seed=0, parameters=values)
    tracker.start(setting.image, setting.box)
    for _ in range(_WARM_UP):
        tracker.update(setting.image)
    return Timed(lambda _: tracker.update(setting.image))


def _update(preset: str, setting: Setting) -> Timed:
    return update(preset, setting, particles=setting.particles)


# What is made of the image, whatever the particles are.
MAPS: Mapping[str, Stage] = MappingProxyType(
    {
        "crop": Stage(lambda setting: Timed(lambda _: setting.region()), _region_pixels),
        "gray range": Stage(_range, _image_pixels),
        "conversion to 8 bit": Stage(_conversion, _deep_pixels),
        "resampling of a window": Stage(_resampling, _window_pixels),
        "features": Stage(_features, _window),
        "spectrum": Stage(_spectrum, _window),
        "response, two sizes": Stage(_response, _window),
        "training": Stage(_training, _window),
        "color numbers": Stage(
            lambda setting: Timed(lambda region: region.color_bins(_LEVELS), setting.region),
            _region_pixels,
        ),
        "color table": Stage(_color_table, _region_pixels),
        "color_contrast, integral image": Stage(
            partial(_scoring, "color_contrast", maps=True), _region_pixels
        ),
        "gradient integral image": Stage(
            lambda setting: Timed(
                lambda region: region.gradient_integral(_DIRECTIONS), setting.region
            ),
            _region_pixels,
        ),
        "hog, integral image": Stage(partial(_scoring, "hog", maps=True), _region_pixels),
        "ViBe": Stage(_background, _image_pixels),
    }
)
# What is done for each particle, the maps being there.
SCORING: Mapping[str, Stage] = MappingProxyType(
    {
        f"{name}, scoring": Stage(partial(_scoring, name, maps=False))
        for name in (
            "color_histogram",
            "gradient_orientation",
            "hog",
            "foreground_color_histogram",
            "foreground",
            "color_contrast",
            "correlation_response",
        )
    }
)
UPDATES: Mapping[str, Stage] = MappingProxyType(
    {
        f"update of {preset}": Stage(partial(_update, preset), _window_pixels)
        for preset in SELF_CONTAINED
    }
)
STAGES: Mapping[str, Stage] = MappingProxyType({**MAPS, **SCORING, **UPDATES})
