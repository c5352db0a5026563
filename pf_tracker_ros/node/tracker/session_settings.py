"""What a session of one target or of several takes from the node's own parameters."""

from __future__ import annotations

from typing import Protocol

from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.frame_clock import TimePolicy


class _Limited(Protocol):
    def limit(self, frames: int, megabytes: float) -> None: ...


class _Settable(Protocol):
    time_policy: TimePolicy

    @property
    def history(self) -> _Limited: ...


def set_up(session: _Settable, values: Values) -> None:
    """Set the time policy and the bounds of the history.

    Args:
        session: To be set up.
        values: Full name to value of the node's parameters.
    """
    session.time_policy = TimePolicy(
        values["time_jump"], round(values["time_jump_threshold"] * NANOSECONDS)
    )
    session.history.limit(values["history_frames"], values["history_megabytes"])
