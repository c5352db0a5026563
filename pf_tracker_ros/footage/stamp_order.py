"""Sorts recorded images by their stamps.

A driver with several threads may publish an image before an earlier one. Each image waits until
`WINDOW` others have come after it. An image whose stamp is more than a second before the latest one
begins a new order, as when a bag contains a recording twice; so does one without a stamp.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator

from pf_tracker_ros.footage.bags import BagImage
from pf_tracker_ros.stamps import LATE_WITHIN

WINDOW = 8
"""Number of images that wait, in serialized form."""


class StampOrder:
    """Sorts the images of one pass through a bag.

    Attributes:
        moved_count: Number of images so far that came after a later one.
    """

    def __init__(self) -> None:
        self.moved_count = 0
        # Stamp, position in the bag, image.
        self._waiting: list[tuple[int, int, BagImage]] = []
        self._latest = 0

    def sort(self, images: Iterable[BagImage]) -> Iterator[BagImage]:
        """Sort images within the window; all come out, also after an error of their source."""
        try:
            for position, image in enumerate(images):
                if not image.stamp or image.stamp < self._latest - LATE_WITHIN:
                    yield from self._rest()
                self.moved_count += 0 < image.stamp < self._latest
                self._latest = max(self._latest, image.stamp)
                heapq.heappush(self._waiting, (image.stamp, position, image))
                if len(self._waiting) > WINDOW:
                    yield heapq.heappop(self._waiting)[2]
        except Exception:
            yield from self._rest()
            raise
        yield from self._rest()

    def _rest(self) -> Iterator[BagImage]:
        while self._waiting:
            yield heapq.heappop(self._waiting)[2]
        self._latest = 0
