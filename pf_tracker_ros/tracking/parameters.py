"""All parameters of the tracker, assembled from those that each part declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.appearances import AppearanceParameters
from pf_tracker_ros.cues import CUES, FusionParameters, TemplateParameters
from pf_tracker_ros.filter import MotionParameters, ProposalParameters, ResamplingParameters
from pf_tracker_ros.parameters import declared, group, parts
from pf_tracker_ros.tracking.redetection import RedetectionParameters
from pf_tracker_ros.tracking.track_parameters import DetectorParameters, TrackParameters


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
