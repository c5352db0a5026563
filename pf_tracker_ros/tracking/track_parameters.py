"""The parameters of a track: how sure, when hidden, and what then."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.hiding import WHILE_HIDDEN
from pf_tracker_ros.tracking.track_state import TrackThresholds


@dataclass(frozen=True)
class TrackParameters(TrackThresholds):
    """When the target counts as hidden, seen again, or gone, and what is done then."""

    confidence_rate: float = declared(
        1.0,
        "Share of each frame in the confidence while it rises; it falls at once. With less, good "
        "looks after a doubtful one must be several. Where the search finds an occluded target "
        "elsewhere, it is what the search says of that place.",
        minimum=0.01,
        maximum=1.0,
    )
    while_hidden: str = declared(
        "coast",
        "What is done while the target is hidden: coast lets the motion model alone carry the "
        "particles on, and searches anew from where the target was lost; follow goes on with the "
        "likeliest place, and only the state tells that it may not be the target.",
        choices=WHILE_HIDDEN,
    )
