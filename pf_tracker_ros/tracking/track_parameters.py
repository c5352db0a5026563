"""The parameters of track states, occlusion and detections."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.assessment import LARGEST
from pf_tracker_ros.tracking.estimate import TrackThresholds
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES


@dataclass(frozen=True)
class TrackParameters(TrackThresholds):
    """Track states, occlusion and re-identification."""

    confidence_calibration: tuple[float, ...] = declared(
        (1.0, 0.0),
        "Scale and offset of the log odds of the reported confidence, as `tune --confidence` fits "
        "them. The thresholds apply to the confidence before that, so boxes and states stay the "
        "same. The scale is at least 0.01.",
        minimum=-LARGEST,
        maximum=LARGEST,
        lengths=(2,),
    )
    occlusion_policy: str = declared(
        "coast",
        "Box of a target that is not tracked. coast: the motion model alone moves the particles; "
        "a lost target is searched from where it was lost. keep_tracking: the likeliest box, and "
        "only the state warns that it may not be the target.",
        choices=OCCLUSION_POLICIES,
    )
    reidentify_within: float = declared(
        10.0,
        "A target from a detector that has ended gets its id back if it is detected again within "
        "this time with a similar appearance; 0 disables re-identification.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )


@dataclass(frozen=True)
class DetectorParameters:
    """Detections to use, and the detector's recall."""

    labels: tuple[str, ...] = declared(
        (),
        "Labels of the detections to use, spelled as by the detector, such as person; empty uses "
        "all.",
    )
    score_above: float = declared(
        0.3,
        "Least score of the detections to use.",
        minimum=0.0,
        maximum=1.0,
    )
    recall: float = declared(
        0.8,
        "Share of the visible targets that the detector finds in a frame; with a higher one, an "
        "undetected target ends sooner.",
        minimum=0.05,
        maximum=0.99,
    )
