"""Families 2 and 4: a template is searched near the last box, as it is or deformed.

Region matching correlates brightness and edges at three sizes, and adapts its template slowly,
where it matches well. For the deformable template a search by correlation finds the place; the
affine map that aligns the template best is then found by maximizing the enhanced correlation
coefficient; the aligned patch renews the template.

Source of the alignment: Evangelidis, Psarakis 2008, "Parametric image alignment using enhanced
correlation coefficient maximization".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from color_image_tracker import Array, Image
from numpy.typing import NDArray

from tracker_families.family import (
    FamilyTracker,
    box_around,
    center_of,
    nearest_match,
    resample,
    to_gray,
    working_size,
)

Channels = NDArray[np.float32]

_LEAST_REACH, _CALM, _FLAT = 16.0, 0.3, 2.0
_SCALES = (1.0, 0.96, 1.04)
# A change of size must match better than none by this factor.
_CHANGE_OF_SCALE = 0.97
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 25, 1e-3)
_SMOOTHING = 3
# Share of each alignment's deformation that the box takes on; the rest is taken for noise.
_DEFORMATION_RATE = 0.3
_SIZE_PER_FRAME = 1.1
_MOST_SHEAR = 0.25


def _search(
    gray: Image,
    box: Array,
    template: Channels,
    reach: float,
    channels: Callable[[NDArray[Any]], Channels],
) -> tuple[Array, float] | None:
    """The place near a box where a template correlates best, and how well; None where it is flat.

    It is searched for within so many sides of the box; channels are what is compared.
    """
    size = np.array(template.shape[1::-1])
    pixel = box[2:] / size
    around = np.ceil(max(reach * np.sqrt(box[2] * box[3]), _LEAST_REACH) / pixel)
    width, height = (size + 2 * around).astype(int).tolist()
    region = box_around(center_of(box), (width, height) * pixel)
    window = resample(gray, region, (width, height))
    if window.std() < _FLAT:
        return None
    place, score = nearest_match(channels(window), template, _CALM)
    return np.concatenate([region[:2] + place * pixel, box[2:]]), score


class TemplateMatching(FamilyTracker):
    """Searches where brightness and edges correlate best with the target's."""

    def _learn(self, image: Image, box: Array) -> None:
        self._size = working_size(box, 40.0)
        self._template = _with_edges(resample(to_gray(image), box, self._size))

    def _find(self, image: Image, box: Array) -> Array | None:
        gray = to_gray(image)
        best, highest = None, 0.4
        for scale in _SCALES:
            scaled = box_around(center_of(box), scale * box[2:])
            found = _search(gray, scaled, self._template, 0.6, _with_edges)
            if found:
                score = found[1] * (1.0 if scale == 1.0 else _CHANGE_OF_SCALE)
                if score > highest:
                    best, highest = found[0], score
        if best is not None and highest > 0.65:
            seen = _with_edges(resample(gray, best, self._size))
            self._template += 0.02 * (seen - self._template)
        return best


class DeformableTemplate(FamilyTracker):
    """Aligns a template by an affine map and lets it adapt."""

    def _learn(self, image: Image, box: Array) -> None:
        self._size = working_size(box, 48.0)
        self._template = _brightness(resample(to_gray(image), box, self._size))

    def _find(self, image: Image, box: Array) -> Array | None:
        gray = to_gray(image)
        rough = _search(gray, box, self._template, 0.5, _brightness)
        if rough is None:
            return None
        found, score = self._align(gray, rough[0])
        if score < 0.5:
            return None
        if score > 0.6:
            seen = resample(gray, found, self._size)
            self._template += 0.1 * (seen - self._template)
        return found

    def _align(self, gray: Image, rough: Array) -> tuple[Array, float]:
        """The box under the aligned template, and the correlation there."""
        size = np.array(self._size)
        # Half a box around it, for the template to move and grow into.
        margin = size // 4
        pixel = rough[2:] / size
        region = box_around(center_of(rough), (size + 2 * margin) * pixel)
        width, height = (size + 2 * margin).tolist()
        window = resample(gray, region, (width, height)).astype(np.float32)
        for kind in (cv2.MOTION_AFFINE, cv2.MOTION_TRANSLATION):
            warp = np.hstack([np.eye(2), margin[:, None]]).astype(np.float32)
            try:
                score, warp = cv2.findTransformECC(
                    self._template, window, warp, kind, _CRITERIA, None, _SMOOTHING
                )
            except cv2.error:  # It did not converge.
                continue
            sides = np.linalg.norm(warp[:, :2], axis=0)
            shear = abs(float(warp[:, 0] @ warp[:, 1])) / float(np.prod(sides))
            moved = warp @ np.append((size - 1) / 2, 1.0) - margin - (size - 1) / 2
            calm = (np.abs(moved) <= margin).all() and shear <= _MOST_SHEAR
            if calm and (np.abs(np.log(sides)) <= np.log(_SIZE_PER_FRAME)).all():
                stretch = 1.0 + _DEFORMATION_RATE * (sides - 1.0)
                return box_around(center_of(rough) + moved * pixel, stretch * rough[2:]), score
        return rough, -1.0


def _brightness(gray: NDArray[Any]) -> Channels:
    return gray.astype(np.float32)


def _with_edges(gray: NDArray[Any]) -> Channels:
    """(H, W, 2): brightness and strength of edges."""
    right = cv2.Sobel(gray, cv2.CV_32F, 1, 0)
    down = cv2.Sobel(gray, cv2.CV_32F, 0, 1)
    # Not by cv2.magnitude, whose last bit hangs on where in memory the arrays lie.
    return np.dstack([gray.astype(np.float32), np.sqrt(right**2 + down**2)])
