"""The states of the track in the log: each new one soon, however often they change."""

from __future__ import annotations

import time
from typing import Any

from pf_tracker_ros.tracking.estimate import Estimate

# A target that flickers at the frame rate is told of once in so long, with the state it is then in.
_INTERVAL = 1.0


class StateLog:
    """Logs changes of the state, the last of them always, within a second.

    It begins with a target that is tracked.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._told = "tracking"
        self._told_at = -_INTERVAL

    def forget(self) -> None:
        """Begin again, with another target or none."""
        self._told = "tracking"

    def tell(self, estimate: Estimate) -> None:
        """Log the state after a frame if it is another than the last one that was told."""
        now = time.monotonic()
        if estimate.state == self._told or now - self._told_at < _INTERVAL:
            return
        self._logger.info(f"{self._told} -> {estimate.state}, confidence {estimate.confidence:.2f}")
        self._told, self._told_at = estimate.state, now
