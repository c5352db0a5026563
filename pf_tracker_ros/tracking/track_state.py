"""Is the target seen, hidden or gone: the track's state over time."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.estimate import TrackState


@dataclass(frozen=True)
class TrackParameters:
    """When the target counts as hidden, seen again, or gone."""

    occluded_below: float = declared(
        0.45,
        "The target counts as occluded while the confidence is below this; 0 switches it off.",
        minimum=0.0,
        maximum=1.0,
    )
    recovered_above: float = declared(
        0.5,
        "An occluded or lost target is seen again when the confidence exceeds this.",
        minimum=0.0,
        maximum=1.0,
    )
    lost_after: float = declared(
        2.0,
        "The target counts as lost after it has been occluded for so long.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    confidence_rate: float = declared(
        1.0,
        "Share of each frame in the confidence while it rises; it falls at once. With less, good "
        "looks after a doubtful one must be several.",
        minimum=0.01,
        maximum=1.0,
    )
    coast: bool = declared(
        True,
        "While the target is occluded, let the motion model alone carry the particles on, and "
        "while it is lost, search anew from where that began. Otherwise the likeliest place is "
        "followed all the time, and only the state tells that it may not be the target.",
    )

    def confidence(self, before: float, similarity: float) -> float:
        """The confidence after a frame, 0 to 1.

        Args:
            before: The confidence after the last frame, 0 to 1.
            similarity: What this frame alone says, 0 to 1.
        """
        if similarity <= before:
            return similarity
        return self.confidence_rate * similarity + (1.0 - self.confidence_rate) * before


@dataclass(frozen=True)
class Track:
    """The state of a track and for how long the target has been out of sight.

    Attributes:
        state: As in `Estimate.state`.
        hidden_for: Seconds since the target was last seen, 0 while tracking.
    """

    state: TrackState = "tracking"
    hidden_for: float = 0.0

    def after(
        self, confidence: float, similarity: float, interval: float, parameters: TrackParameters
    ) -> Track:
        """The track one frame later.

        Args:
            confidence: After that frame, 0 to 1.
            similarity: What that frame alone says, 0 to 1; a glimpse starts the clock again, even
                before the confidence has risen.
            interval: Seconds since the last frame.
            parameters: The thresholds.
        """
        needed = parameters.occluded_below
        if self.state != "tracking":
            needed = max(needed, parameters.recovered_above)
        if confidence >= needed:
            return Track()
        hidden_for = interval + (self.hidden_for if similarity < needed else 0.0)
        gone = hidden_for >= parameters.lost_after
        return Track("lost" if gone else "occluded", hidden_for)
