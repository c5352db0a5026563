"""Family 5, optical flow: the dense flow around the target is clustered into target and background.

DIS flow from the last image to this one, clustered by k-means over motion and place. The clusters
that lie mostly in the box are the target's: their motion carries the box, what they span corrects
its place and size. Where nothing moves by itself, the box goes with the flow in it.

Source of the flow: Kroeger and others 2016, "Fast optical flow using dense inverse search".
"""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Image

from tracker_families.family import (
    FamilyTracker,
    box_around,
    center_of,
    resample,
    to_gray,
    working_size,
)

_SIDE = 64.0
_AROUND = 2.2
_STEP = 2
_CLUSTERS = 4
_INSIDE = 0.6
# Flow in working pixels by which a cluster must differ from the surroundings to be told from them.
_OWN_MOTION = 0.35
_CENTER_RATE = 0.15
_STRAYING = 0.05
_SIZE_RATE = 0.05


class FlowClusters(FamilyTracker):
    """Follows the clusters of motion that fill the box."""

    def _learn(self, image: Image, box: Array) -> None:
        self._flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self._before = to_gray(image)
        self._velocity = np.zeros(2)
        self._count = 0

    def _find(self, image: Image, box: Array) -> Array:
        before, now = self._before, to_gray(image)
        self._before = now
        self._count += 1
        size = working_size(box_around((0, 0), _AROUND * box[2:]), _AROUND * _SIDE)
        pixel = _AROUND * box[2:] / size
        region = box_around(center_of(box), _AROUND * box[2:])
        # The second image is taken where the target is expected: a fast one is then still found.
        ahead = region + np.concatenate([self._velocity, (0.0, 0.0)])
        flow = self._flow.calc(resample(before, region, size), resample(now, ahead, size), None)
        flow = flow[::_STEP, ::_STEP].reshape(-1, 2).astype(float)
        places = _places(size)
        inside = (np.abs(places) < 0.5 / _AROUND).all(axis=1)
        own = self._own(flow, places, inside)
        ring = (np.abs(places) > 0.65 / _AROUND).any(axis=1)
        if own is None or _apart(flow[own], flow[ring]) < _OWN_MOTION:
            motion, shift, growth = np.median(flow[inside], axis=0), np.zeros(2), np.ones(2)
        else:
            motion = np.median(flow[own & inside], axis=0)
            # The middle and the size of what the samples span, but for a few that stray.
            low, high = np.quantile(places[own], (_STRAYING, 1.0 - _STRAYING), axis=0) * _AROUND
            shift = _CENTER_RATE * (low + high) / 2 * box[2:]
            span = (high - low) / (1.0 - 2.0 * _STRAYING)
            growth = np.clip(span, 0.8, 1.25) ** _SIZE_RATE
        moved = self._velocity + motion * pixel
        limit = box[2:] / 3
        self._velocity = np.clip(0.5 * (self._velocity + moved), -limit, limit)
        return box_around(center_of(box) + moved + shift, growth * box[2:])

    def _own(self, flow: Array, places: Array, inside: Array) -> Array | None:
        """Which samples belong to the target's clusters; None if no cluster is the target's."""
        spread = max(float(flow.std()), 0.1)
        features = np.hstack([flow / spread, 2.0 * places]).astype(np.float32)
        cv2.setRNGSeed((self._seed * 65536 + self._count) % 2**31)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.05)
        _, labels, _ = cv2.kmeans(features, _CLUSTERS, None, criteria, 2, cv2.KMEANS_PP_CENTERS)
        labels = labels.ravel()
        shares = [inside[labels == label].mean() for label in range(_CLUSTERS)]
        own = np.isin(labels, np.flatnonzero(np.array(shares) > _INSIDE))
        # A speck in the box says little of the target.
        return own if (own & inside).sum() > 0.15 * inside.sum() else None


def _places(size: tuple[int, int]) -> Array:
    """(samples, 2) where each sample of the flow lies in the region, from -0.5 to 0.5."""
    columns, rows = ((np.arange(0, side, _STEP) + 0.5) / side - 0.5 for side in size)
    return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)


def _apart(first: Array, second: Array) -> float:
    return float(np.linalg.norm(np.median(first, axis=0) - np.median(second, axis=0)))
