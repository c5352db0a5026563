"""The last messages of a sensor, found by stamp: never the latest in place of the right one."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Generic, TypeVar

from pf_tracker_ros.stamps import NANOSECONDS

Item = TypeVar("Item")

# An item that is older than the newest one by more than this is the first after a jump of the
# clock, nanoseconds.
_JUMP = NANOSECONDS


class StampedBuffer(Generic[Item]):
    """Items in the order of their stamps.

    A jump of the clock back, or ahead of all others, forgets the items before it: the clock has
    changed, and items of both clocks would be mixed.

    Args:
        max_age: Age of the oldest item relative to the newest one, nanoseconds.
        max_count: Maximum number of items.
    """

    def __init__(self, max_age: int, max_count: int) -> None:
        self._max_age = max_age
        self._max_count = max_count
        self._stamps: list[int] = []
        self._items: list[Item] = []

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def newest(self) -> int | None:
        """Stamp of the newest item, nanoseconds; None without items."""
        return self._stamps[-1] if self._stamps else None

    def add(self, stamp: int, item: Item) -> bool:
        """Add an item; one with the same stamp is replaced.

        Args:
            stamp: Nanoseconds.
            item: The item.

        Returns:
            Whether its clock has jumped back.
        """
        jumped_back = self.newest is not None and stamp < self.newest - _JUMP
        if jumped_back:
            self.clear()
        index = bisect_left(self._stamps, stamp)
        if index < len(self._stamps) and self._stamps[index] == stamp:
            self._items[index] = item
        else:
            self._stamps.insert(index, stamp)
            self._items.insert(index, item)
        oldest = self._stamps[-1] - self._max_age
        excess = max(bisect_left(self._stamps, oldest), len(self._stamps) - self._max_count)
        del self._stamps[:excess], self._items[:excess]
        return jumped_back

    def nearest(self, stamp: int) -> tuple[int, Item] | None:
        """The stamp and item nearest to a stamp; None without items."""
        index = bisect_left(self._stamps, stamp)
        near = range(max(index - 1, 0), min(index + 1, len(self._stamps)))
        if not near:
            return None
        best = min(near, key=lambda one: abs(self._stamps[one] - stamp))
        return self._stamps[best], self._items[best]

    def around(self, stamp: int) -> tuple[tuple[int, Item] | None, tuple[int, Item] | None]:
        """The last item until a stamp and the first one from it on, each with its stamp."""
        after = bisect_left(self._stamps, stamp)
        before = bisect_right(self._stamps, stamp) - 1
        return (
            (self._stamps[before], self._items[before]) if before >= 0 else None,
            (self._stamps[after], self._items[after]) if after < len(self._stamps) else None,
        )

    def limit(self, max_count: int) -> None:
        """Keep at most so many items from now on."""
        self._max_count = max_count

    def clear(self) -> None:
        """Forget all items."""
        self._stamps.clear()
        self._items.clear()
