"""What is told of a target."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.tracking.estimate import Estimate


@dataclass(frozen=True)
class TrackedTarget:
    """One of several targets in one frame, a value.

    Attributes:
        id: Its own from 1 on, never that of another.
        label: What it was called most, by the detector or by hand; an empty text if nothing.
        estimate: Where it is, as for a single target. Its state is "occluded" also where another
            target is in front of it.
        age: Seconds since it began.
        unconfirmed_for: Seconds since a detection last confirmed it, or since it was started.
    """

    id: int
    label: str
    estimate: Estimate
    age: float
    unconfirmed_for: float
