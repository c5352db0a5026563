"""Prefetching in a thread, so that reading a slow frame does not delay the frames before it."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")

_END: Any = object()


class Prefetch(Generic[Item]):
    """Iterator over items that another thread reads ahead.

    An error of the source is raised in place of the item. The source is opened, read and closed in
    that one thread.

    Args:
        items: The source.
        depth: Largest number of items read ahead.
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
