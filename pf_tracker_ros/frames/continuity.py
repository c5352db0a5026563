"""Whether an image shows the scene of the images before it, or another one after a cut.

Two images are compared by a grid of blocks of sampled pixels. There is a cut between them where
their blocks correlate by |rho| < 0.8 (a thermal camera may swap black and white) and differ by e in
the median, beside a usual mean difference of E in the same stream, with (1 - |rho|) e / E > 1.5.
rho is the largest of three: of the blocks, and of those of either image in the grays of the other.
Light that jumps makes the brightest of them equally white, and keeps the order of the others.
The images show another scene until another cut leads back to one like the last before, or for 5 s:
it may have been the camera that turned. After a gap of over half a second it probably has, as that
of a robot: these images are not compared.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# (width, height) of the samples and of the blocks' grid.
_SAMPLES, _BLOCKS = (128, 96), (32, 24)
# Correlation below which images may be of two scenes; least (1 - |rho|) e / E of a cut.
_ALIKE_ABOVE, _CUT_ABOVE = 0.8, 1.5
# Share of an image in the usual difference; the least one, in standard deviations of the blocks.
_USUAL_SHARE, _LEAST_USUAL = 0.1, 0.01
# Largest seconds between two images that are compared.
_COMPARED_WITHIN = 0.5
# Seconds after which another scene is the present one, but for the rounding of their sum.
_ACCEPTED_AFTER = 5.0 - 1e-6

OTHER_SCENE = 0.05
"""Factor of the odds that a box in another scene shows the target."""


class Continuity:
    """Compares each image of a stream with the one before."""

    def __init__(self) -> None:
        self._samples: NDArray[Any] | None = None
        self._usual: float | None = None
        # Blocks of the last image before a cut; None before the first one.
        self._before_cut: NDArray[np.float32] | None = None
        # Seconds for which another scene is shown; infinite while it is the present one.
        self._other_for = math.inf

    def update(self, image: NDArray[np.generic], interval: float) -> float:
        """Process the next image, as of `Frame`; all have the same size and type.

        Returns:
            Factor of the odds that a box in this image shows its target: 1, or `OTHER_SCENE`.
        """
        samples = cv2.resize(image, _SAMPLES, interpolation=cv2.INTER_NEAREST)
        if samples.dtype == np.float32:
            _fill_holes(samples, self._samples)
        last, self._samples = self._samples, samples
        if last is None:
            return 1.0
        self._other_for += interval
        is_other = self._other_for < _ACCEPTED_AFTER
        if interval > _COMPARED_WITHIN:
            return OTHER_SCENE if is_other else 1.0
        difference = cv2.norm(last, samples, cv2.NORM_L1) / last.size
        usual = difference if self._usual is None else self._usual
        # Most images change as usual, and need no correlation.
        if difference <= _CUT_ABOVE * usual or not _is_cut(last, samples, usual):
            self._usual = usual + _USUAL_SHARE * (difference - usual)
        elif self._before_cut is not None and (
            _likeness(self._before_cut, _blocks(samples)) >= _ALIKE_ABOVE
        ):
            is_other, self._other_for = False, math.inf
        elif not is_other:
            self._before_cut, self._other_for, is_other = _blocks(last), 0.0, True
        return OTHER_SCENE if is_other else 1.0


def _fill_holes(samples: NDArray[Any], last: NDArray[Any] | None) -> None:
    """Replace what is not finite by the last samples, or by the median, 0 without any."""
    is_hole = ~np.isfinite(samples)
    if not is_hole.any():
        return
    if last is not None:
        samples[is_hole] = last[is_hole]
    else:
        samples[is_hole] = 0.0 if is_hole.all() else np.median(samples[~is_hole])


def _is_cut(last: NDArray[Any], now: NDArray[Any], usual: float) -> bool:
    before, after = _blocks(last), _blocks(now)
    likeness = _likeness(before, after)
    if likeness >= _ALIKE_ABOVE:
        return False
    usual = max(usual, _LEAST_USUAL * float(before.std()))
    # An object before a uniform background changes few blocks.
    difference = float(np.median(np.abs(after - before)))
    return (1.0 - likeness) * difference > _CUT_ABOVE * usual


def _blocks(samples: NDArray[Any]) -> NDArray[np.float32]:
    """(24, 32) means of the blocks."""
    means = cv2.resize(samples.astype(np.float32), _BLOCKS, interpolation=cv2.INTER_AREA)
    return np.asarray(means if means.ndim == 2 else means.mean(axis=2), dtype=np.float32)


def _likeness(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Magnitude of the correlation of blocks, as they are or with the grays of one in the other."""
    return max(
        abs(_correlation(one, other)),
        _correlation(_in_grays_of(other, one), other),
        _correlation(one, _in_grays_of(one, other)),
    )


def _in_grays_of(model: NDArray[np.float32], blocks: NDArray[np.float32]) -> NDArray[np.float32]:
    """The blocks with the grays of others, the darkest as the darkest and so on."""
    mapped = np.empty(blocks.size, np.float32)
    mapped[np.argsort(blocks, axis=None, kind="stable")] = np.sort(model, axis=None)
    return mapped.reshape(blocks.shape)


def _correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """That of blocks, -1 to 1; 1 if one of them has no contrast."""
    first, second = (blocks.ravel() - blocks.mean() for blocks in (one, other))
    product = math.sqrt(float(first @ first) * float(second @ second))
    return float(first @ second) / product if product > 0.0 else 1.0
