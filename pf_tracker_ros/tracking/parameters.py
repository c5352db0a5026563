"""All parameters of the tracker, assembled from those that each part declares, and their checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.appearances import AppearanceParameters
from pf_tracker_ros.cues import CUES, CueFusion, FusionParameters, TemplateParameters
from pf_tracker_ros.filter import MotionParameters, ProposalParameters, ResamplingParameters
from pf_tracker_ros.filter.motion import MOTION_MODELS, models_with
from pf_tracker_ros.parameters import ParameterError, declared, group, parts
from pf_tracker_ros.tracking.assessment import LARGEST
from pf_tracker_ros.tracking.estimate import TrackThresholds
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES
from pf_tracker_ros.tracking.redetection import RedetectionParameters

# Proposal method to the method that it requires of the motion model.
_REQUIRED = {"kalman": "kalman_filter", "search": "center_prior"}


@dataclass(frozen=True)
class TargetCountParameters:
    """Number of targets; the presets have different values for one and for several."""

    max_targets: int = declared(
        1,
        "Maximum number of targets at a time. With 1, a new target replaces the last one. With "
        "more, detections start further targets, and the presets have values for several "
        "targets. Each target costs about as much as a single one.",
        minimum=1,
        maximum=1000,
    )


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
    keep_selected: float = declared(
        120.0,
        "The selected target stays for this time after its last detection, and keeps its id when "
        "it is found again.",
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


@dataclass(frozen=True)
class TrackerParameters(TargetCountParameters):
    """The tracker's parameters and their defaults; a preset changes some of them."""

    particles: int = declared(
        300,
        "Number of particles; more are more precise and cost more.",
        minimum=1,
        maximum=100_000,
    )
    working_size: int = declared(
        40,
        "Largest target size, sqrt(width * height), at full resolution. For a larger target, the "
        "image is reduced by the whole factor that brings its size to this or below. This bounds "
        "the cost: a target of any size in an image of 1920 x 1080 costs at most about three times "
        "as much as one of 40 px.",
        unit="px",
        minimum=8,
        maximum=4096,
        read_only=True,
    )
    follow_light: bool = declared(
        False,
        "Whether the cues see 8 bit images at constant brightness, with changes of exposure or "
        "lighting compensated.",
    )
    motion: MotionParameters = group(MotionParameters)
    proposal: ProposalParameters = group(ProposalParameters)
    resampling: ResamplingParameters = group(ResamplingParameters)
    cues: tuple[str, ...] = declared(
        ("color_histogram", "gradient_orientation"),
        "Cues that compare a box with the target; each has its own parameters. A cue that is added "
        "while a target is tracked learns it from the next trusted frame.",
        choices=CUES,
    )
    of_cues: dict[str, Any] = parts("cues", CUES)
    fusion: FusionParameters = group(FusionParameters, only_with=("proposal.method", "search"))
    redetection: RedetectionParameters = group(
        RedetectionParameters, only_with=("proposal.method", "search")
    )
    template: TemplateParameters = group(TemplateParameters)
    track: TrackParameters = group(TrackParameters)
    detector: DetectorParameters = group(DetectorParameters)
    appearance: AppearanceParameters = group(AppearanceParameters)


def check_proposal(parameters: TrackerParameters, fusion: CueFusion) -> None:
    """Check the motion model, and that it and the cues support the proposal.

    Raises:
        ParameterError: They do not; names the allowed values.
    """
    method, model = parameters.proposal.method, parameters.motion.model
    # Report an unusable model now, not when the first target needs it.
    MOTION_MODELS.check(model)
    supported = [one for one, required in _REQUIRED.items() if model in models_with(required)]
    methods = " or ".join(f"'{one}'" for one in ("transition", *supported) if one != method)
    if method in _REQUIRED and method not in supported:
        models = " or ".join(f"'{name}'" for name in models_with(_REQUIRED[method]))
        raise ParameterError(
            f"parameter 'proposal.method' is '{method}' with the motion model '{model}'; allowed: "
            f"{methods}, or the motion model {models}"
        )
    if method == "search" and not fusion.can_search:
        searchable = " or ".join(
            f"'{name}'" for name, cue in CUES.items() if hasattr(cue, "response")
        )
        raise ParameterError(
            "parameter 'proposal.method' is 'search', but no cue in 'cues' can search with a "
            f"weight above 0; allowed: {methods}, or {searchable} in 'cues'"
        )
