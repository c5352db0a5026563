"""The parameters of a track, how sure, when hidden and what then; and of what detects targets."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.estimate import TrackThresholds
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES


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
    occlusion_policy: str = declared(
        "coast",
        "What is done while the target is hidden: coast lets the motion model alone carry the "
        "particles on, and searches anew from where the target was lost; keep_tracking goes on with the "
        "likeliest place, and only the state tells that it may not be the target.",
        choices=OCCLUSION_POLICIES,
    )
    reidentify_within: float = declared(
        10.0,
        "A target that a detector started and that has ended is the same one if the detector sees "
        "it again within this time and it looks alike; 0 remembers none.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )


@dataclass(frozen=True)
class DetectorParameters:
    """What is known of the detector that starts and corrects targets."""

    labels: tuple[str, ...] = declared(
        (),
        "Labels of the detections that count, as the detector writes them, such as person; empty "
        "takes all.",
    )
    score_above: float = declared(
        0.3,
        "Detections of a lower score are left out.",
        minimum=0.0,
        maximum=1.0,
    )
    recall: float = declared(
        0.8,
        "Share of the visible targets that the detector finds in a frame; with a higher one, a "
        "target that it does not find ends sooner.",
        minimum=0.05,
        maximum=0.99,
    )
