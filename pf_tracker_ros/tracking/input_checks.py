"""Checks of the user's input besides images: boxes, intervals, shares, seeds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.tracking.hints import Hint

# Largest side of an expected box over the other: the search takes more positions for each.
_LARGEST_ASPECT = 20


def check_box(box: ArrayLike, image_size: tuple[int, int]) -> Box:
    """The box (x, y, width, height) in pixels as four floats, in an image of (width, height).

    Raises:
        ValueError: Not four finite numbers, no area, larger than the image, or outside it.
    """
    values = _numbers(box)
    if values is None or values.shape != (4,) or not np.isfinite(values).all():
        raise ValueError(
            f"box is {box!r}; expected four finite numbers (x, y, width, height) in pixels"
        )
    x, y, width, height = (float(value) for value in values)
    image_width, image_height = image_size
    text = f"box ({x:g}, {y:g}, {width:g}, {height:g})"
    if width < 1.0 or height < 1.0:
        raise ValueError(f"{text} is too small; width and height must be at least 1 px")
    if width > image_width or height > image_height:
        raise ValueError(f"{text} is larger than the image, {image_width} x {image_height} px")
    center_x, center_y = x + width / 2, y + height / 2
    if not (0 <= center_x <= image_width and 0 <= center_y <= image_height):
        raise ValueError(
            f"the center of {text} is outside the image, {image_width} x {image_height} px"
        )
    return x, y, width, height


def check_seconds(value: float, name: str) -> float:
    """An interval or age as a float.

    Raises:
        ValueError: Not a finite number of at least 0.
    """
    seconds = _numbers(value)
    if seconds is None or seconds.shape != () or not 0.0 <= seconds < math.inf:
        raise ValueError(f"{name} is {value!r}; allowed: a finite number of seconds from 0 up")
    return float(seconds)


def check_hint(hint: Hint) -> Hint:
    """The hint, with the covered share as a float.

    Raises:
        ValueError: The share is not a number from 0 to 1, or another number not finite or too
            small.
    """
    box, standing = hint.box or (0.0, 0.0, 1.0, 1.0), hint.standing or (0.0, 1.0)
    numbers = [*box, *standing, hint.center_std, hint.place_odds]
    if not (np.isfinite(numbers).all() and hint.center_std >= 0.0):
        raise ValueError(f"{hint} is no hint; allowed: finite numbers, center_std from 0 up")
    if min(box[2], box[3], standing[1]) <= 0.0:
        raise ValueError(f"{hint} is no hint; allowed: width, height and slope above 0")
    if max(box[2] / box[3], box[3] / box[2]) > _LARGEST_ASPECT:
        raise ValueError(
            f"{hint} is no hint; allowed: sides that differ by a factor of up to {_LARGEST_ASPECT}"
        )
    share = hint.covered_share
    return hint if share is None else hint._replace(covered_share=check_share(share))


def check_share(share: float) -> float:
    """The covered share of a box as a float.

    Raises:
        ValueError: Not a number from 0 to 1.
    """
    value = _numbers(share)
    if value is None or value.shape != () or not 0.0 <= value <= 1.0:
        raise ValueError(f"the covered share is {share!r}; allowed: a number from 0 to 1")
    return float(value)


def check_seed(seed: object) -> int:
    """The seed as an int.

    Raises:
        ValueError: Not a whole number of at least 0.
    """
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool) and seed >= 0:
        return int(seed)
    raise ValueError(f"seed is {seed!r}; allowed: a whole number from 0 up")


def _numbers(values: object) -> NDArray[np.float64] | None:
    """Real numbers of any shape as an array, or None.

    Booleans, strings, times, complex numbers and objects give None, although NumPy converts some.
    """
    if isinstance(values, Sequence) and any(isinstance(one, bool | np.bool_) for one in values):
        return None
    try:
        array = np.asarray(values)
        return array.astype(np.float64) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        return None
