"""Reading ahead in a thread, so that a slow frame does not delay the ones before it."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")

_END: Any = object()


class Prefetch(Generic[Item]):
    """Iterates over items that a thread of its own reads a few steps ahead.

    An error of the source is raised where the item that it replaces would have come. The source
    is opened, read and closed in the one thread.

    Args:
        items: What to read.
        depth: How many items at most wait to be taken.
    """

    def __init__(self, items: Generator[Item, None, None], depth: int = 4) -> None:
        self._items = items
        self._thread = ThreadPoolExecutor(1, "prefetch")
        self._ahead = deque(self._read() for _ in range(depth))

    def __iter__(self) -> Iterator[Item]:
        while (item := self._ahead.popleft().result()) is not _END:
            self._ahead.append(self._read())
            yield item

    def close(self) -> None:
        """Stop reading and wait until the source is closed."""
        for item in self._ahead:
            item.cancel()
        self._thread.submit(self._items.close)
        self._thread.shutdown()

    def _read(self) -> Future[Item]:
        return self._thread.submit(next, self._items, _END)
