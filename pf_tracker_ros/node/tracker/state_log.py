"""The states of the track in the log: each new one soon, however often they change."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pf_tracker_ros.tracking.estimate import Estimate

if TYPE_CHECKING:
    from pf_tracker_ros.targets.tracked_target import TrackedTarget

# A target that flickers at the frame rate is told of once in so long, with the state it is then in.
_INTERVAL = 1.0


class StateLog:
    """Logs changes of the selected target's state, the last of them always, within a second.

    Another target counts as tracked before.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._id = 0
        self._told = "tracking"
        self._told_at = -_INTERVAL

    def tell(self, id: int, estimate: Estimate) -> None:
        """Log the state after a frame if it is another than the last one that was told.

        Args:
            id: Of the target.
            estimate: What is known of it.
        """
        if id != self._id:
            self._id, self._told = id, "tracking"
        now = time.monotonic()
        if estimate.state == self._told or now - self._told_at < _INTERVAL:
            return
        self._logger.info(f"{self._told} -> {estimate.state}, confidence {estimate.confidence:.2f}")
        self._told, self._told_at = estimate.state, now


class TargetsLog:
    """Logs which targets there are, once they are others, the last of them within a second.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._told: tuple[int, ...] = ()
        self._told_at = -_INTERVAL

    def tell(self, targets: Sequence[TrackedTarget]) -> None:
        """Log the targets after a frame if they are others than the last ones that were told."""
        now = time.monotonic()
        ids = tuple(target.id for target in targets)
        if ids == self._told or now - self._told_at < _INTERVAL:
            return
        listed = ", ".join(f"{target.id} {target.label}".rstrip() for target in targets)
        self._logger.info(f"targets: {listed or 'none'}")
        self._told, self._told_at = ids, now
