"""Reading ahead in a thread, so that a slow frame does not delay the ones before it."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterator
from typing import Generic, TypeVar

Item = TypeVar("Item")

# How often a full queue looks whether anybody still wants its items.
_CLOSING_INTERVAL = 0.05


class _End:
    """Marks the end of the items, with the error that ended them."""

    def __init__(self, error: Exception | None) -> None:
        self.error = error


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
        self._queue: queue.Queue[Item | _End] = queue.Queue(maxsize=depth)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, name="prefetch", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Item]:
        while True:
            item = self._queue.get()
            if isinstance(item, _End):
                if item.error is not None:
                    raise item.error
                return
            yield item

    def close(self) -> None:
        """Stop reading and wait until the source is closed."""
        self._closing.set()
        self._thread.join()

    def _read(self) -> None:
        error: Exception | None = None
        try:
            for item in self._items:
                if not self._put(item):
                    break
        except Exception as raised:
            error = raised
        finally:
            self._items.close()
        self._put(_End(error))

    def _put(self, item: Item | _End) -> bool:
        while not self._closing.is_set():
            try:
                self._queue.put(item, timeout=_CLOSING_INTERVAL)
                return True
            except queue.Full:
                continue
        return False
