"""Every tunable of the tracker, put together from what each part declares."""

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
    """How many targets there may be, which decides on the values of presets, too."""

    max_targets: int = declared(
        1,
        "Most targets at a time. With 1, a new target takes the place of the one before. With "
        "more, detections start others, each costs about as much as one, and the presets have "
        "values that suit several.",
        minimum=1,
        maximum=1000,
    )


@dataclass(frozen=True)
class TrackerParameters(TargetCountParameters):
    """The tracker's tunables; a preset names its values over these defaults."""

    particles: int = declared(
        300,
        "Number of particles; more are steadier and cost more.",
        minimum=1,
        maximum=100_000,
    )
    working_size: int = declared(
        40,
        "Targets whose sqrt(width * height) is above this are looked at in an image reduced by a "
        "whole factor that brings it to this or below, which bounds the cost: a target of any size "
        "in an image of 1920 x 1080 costs at most about three times what one of 40 px does.",
        unit="px",
        minimum=8,
        maximum=4096,
        read_only=True,
    )
    follow_light: bool = declared(
        False,
        "Whether images of 8 bit that become brighter or darker as a whole, by an exposure that is "
        "set anew or a lamp, are shown to the cues in the brightness of those before.",
    )
    motion: MotionParameters = group(MotionParameters)
    proposal: ProposalParameters = group(ProposalParameters)
    resampling: ResamplingParameters = group(ResamplingParameters)
    cues: tuple[str, ...] = declared(
        ("color_histogram", "gradient_orientation"),
        "What a box is compared by; each has parameters of its own. One that is added while a "
        "target is tracked learns it from the next trusted frame.",
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
