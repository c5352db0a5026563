"""Family 4, deformable template: an adaptive template is warped onto the image.

A search by correlation finds the place; the affine map that aligns the template best is then
found by maximizing the enhanced correlation coefficient; the aligned patch renews the template.

Source of the alignment: Evangelidis, Psarakis 2008, "Parametric image alignment using enhanced
correlation coefficient maximization".
"""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Image

from tracker_families.family import (
    FamilyTracker,
    box_around,
    center_of,
    nearest_match,
    resample,
    to_gray,
    working_size,
)

_SIDE = 48.0
_REACH = 0.5
_LEAST_REACH = 16.0
_CALM = 0.3
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 25, 1e-3)
_SMOOTHING = 3
_FOUND = 0.5
_TRUSTED = 0.6
_RATE = 0.1
# Share of each alignment's deformation that the box takes on; the rest is taken for noise.
_DEFORMATION_RATE = 0.3
_SIZE_PER_FRAME = 1.1
_MOST_SHEAR = 0.25
_FLAT = 2.0


class DeformableTemplate(FamilyTracker):
    """Aligns a template by an affine map and lets it adapt."""

    def _learn(self, image: Image, box: Array) -> None:
        self._size = working_size(box, _SIDE)
        self._template = resample(to_gray(image), box, self._size).astype(np.float32)

    def _find(self, image: Image, box: Array) -> Array | None:
        gray = to_gray(image)
        rough = self._search(gray, box)
        if rough is None:
            return None
        found, score = self._align(gray, rough)
        if score < _FOUND:
            return None
        if score > _TRUSTED:
            seen = resample(gray, found, self._size)
            self._template += _RATE * (seen - self._template)
        return found

    def _search(self, gray: Image, box: Array) -> Array | None:
        """The place, near the last one, where the template as it is correlates best."""
        pixel = box[2:] / self._size
        reach = np.ceil(max(_REACH * np.sqrt(box[2] * box[3]), _LEAST_REACH) / pixel)
        width, height = (self._size + 2 * reach).astype(int).tolist()
        region = box_around(center_of(box), (width, height) * pixel)
        window = resample(gray, region, (width, height)).astype(np.float32)
        if window.std() < _FLAT:
            return None
        place, _ = nearest_match(window, self._template, _CALM)
        return np.concatenate([region[:2] + place * pixel, box[2:]])

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
