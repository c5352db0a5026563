"""Is the target seen, hidden or gone: the track's state over time."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.estimate import TrackState

# Seconds for which a target that was lost and is seen again may still turn out to be another.
_PROBATION = 2.0


@dataclass(frozen=True)
class TrackThresholds:
    """When the target counts as hidden, seen again, or gone."""

    occluded_below: float = declared(
        0.45,
        "The target counts as occluded while the confidence is below this; 0 switches it off.",
        minimum=0.0,
        maximum=1.0,
    )
    recovered_above: float = declared(
        0.5,
        "An occluded or lost target is seen again when the confidence reaches this, and also "
        "'occluded_below', or when the search finds an occluded one elsewhere.",
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


@dataclass(frozen=True)
class Track:
    """The state of a track and for how long the target has been out of sight.

    Attributes:
        state: As in `Estimate.state`.
        hidden_for: Seconds since the target was last seen, 0 while tracking.
        probation: Seconds, counted from when it is tracked again, for which it may yet turn out
            that something else was found instead of the target that was lost; nothing is learned of
            it in them.
    """

    state: TrackState = "tracking"
    hidden_for: float = 0.0
    probation: float = 0.0

    @property
    def is_settled(self) -> bool:
        """Whether the target is seen, and was not lost a short time ago."""
        return self.state == "tracking" and self.probation == 0.0

    def lose(self, thresholds: TrackThresholds) -> Track:
        """The track if what is followed was something else all the time."""
        return Track("lost", thresholds.lost_after)

    def advance(
        self, confidence: float, similarity: float, interval: float, thresholds: TrackThresholds
    ) -> Track:
        """The track one frame later.

        Args:
            confidence: After that frame, 0 to 1.
            similarity: What that frame alone says, 0 to 1; a glimpse starts the clock again, even
                before the confidence has risen.
            interval: Seconds since the last frame.
            thresholds: When it counts as hidden, seen again, or gone.
        """
        needed = thresholds.occluded_below
        if self.state != "tracking":
            needed = max(needed, thresholds.recovered_above)
        was_lost = self.state == "lost" or self.probation > 0.0
        if confidence >= needed:
            if self.state == "tracking":
                return Track(probation=max(self.probation - interval, 0.0))
            return Track(probation=_PROBATION if was_lost else 0.0)
        is_glimpsed = similarity >= needed
        hidden_for = interval + (0.0 if is_glimpsed else self.hidden_for)
        if is_glimpsed:
            return Track("occluded", hidden_for, _PROBATION if was_lost else 0.0)
        # What is not confirmed is as lost as it was before.
        gone = was_lost or hidden_for >= thresholds.lost_after
        return Track("lost" if gone else "occluded", hidden_for)
