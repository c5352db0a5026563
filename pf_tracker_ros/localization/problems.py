"""What is wrong with the inputs: logged once in a sentence, and kept while it lasts."""

from __future__ import annotations

import re
import time
from typing import Any

# Seconds until a sentence that comes and goes is logged again.
_LOG_INTERVAL = 60.0
_LONGEST = 1000
_NUMBERS = re.compile(r"-?[\d.]+")


class Problems:
    """The present problems by topic; sentences that differ only in numbers are the same.

    Args:
        logger: Logger of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._present: dict[str, str] = {}
        self._logged_at: dict[tuple[str, str], float] = {}

    @property
    def sentences(self) -> tuple[str, ...]:
        """The present problems."""
        return tuple(self._present.values())

    def set(self, topic: str, sentence: str) -> None:
        """Set the problem of a topic; an empty sentence means that it has none."""
        if not sentence:
            self._present.pop(topic, None)
            return
        sentence = sentence[:_LONGEST]
        self._present[topic] = sentence
        self.tell(topic, sentence)

    def tell(self, topic: str, sentence: str) -> None:
        """Log an event that does not last."""
        kind = topic, _NUMBERS.sub("", sentence)
        now = time.monotonic()
        if now - self._logged_at.get(kind, -_LOG_INTERVAL) >= _LOG_INTERVAL:
            self._logger.warning(sentence[:_LONGEST])
            self._logged_at[kind] = now

    def clear(self) -> None:
        """Forget all problems, as after a deactivation."""
        self._present.clear()
        self._logged_at.clear()
