"""What is known of a target from outside of the image, as from its position in meters."""

from __future__ import annotations

from typing import NamedTuple

from pf_tracker_ros.boxes import Box


class Standing(NamedTuple):
    """How high the boxes of standing targets are: in proportion to the distance to the horizon.

    Attributes:
        horizon: Row of the horizon, pixels.
        slope: Height of a box over the distance of its lower edge from the horizon: that of a
            target over that of the camera.
    """

    horizon: float
    slope: float

    def lower_edge(self, height: float) -> float:
        """Row of the lower edge of a box, pixels."""
        return self.horizon + height / self.slope


class Hint(NamedTuple):
    """What is known of a target in a frame.

    Attributes:
        covered_share: Share of its box, 0 to 1, that something in front covers; None where that is
            unknown.
        box: Where it is expected, pixels; None where that is unknown.
        center_std: Standard deviation of the box's center, pixels.
        standing: Heights of boxes in the image; None where the ground is unknown.
        place_odds: Log odds, at most 0, that it is the target by its place in meters.
    """

    covered_share: float | None = None
    box: Box | None = None
    center_std: float = 0.0
    standing: Standing | None = None
    place_odds: float = 0.0
