"""Every tunable of the tracker, put together from what each part declares."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.background import BackgroundParameters
from pf_tracker_ros.cues import (
    ColorHistogramParameters,
    CorrelationResponseParameters,
    ForegroundProbabilityParameters,
    FusionParameters,
    GradientOrientationParameters,
    MovingForegroundParameters,
    OrientedGradientsParameters,
    TemplateParameters,
)
from pf_tracker_ros.filter import (
    AdaptiveNumberParameters,
    MotionParameters,
    ProposalParameters,
    ResamplingParameters,
)
from pf_tracker_ros.parameters import declared, group
from pf_tracker_ros.tracking.redetection import RedetectionParameters
from pf_tracker_ros.tracking.track_state import TrackParameters


@dataclass(frozen=True)
class TrackerParameters:
    """The tracker's tunables; a preset names its values over these defaults."""

    particles: int = declared(
        300,
        "Number of particles; more are steadier and cost more.",
        minimum=1,
        maximum=100_000,
    )
    nominal_interval: float = declared(
        0.04,
        "Time between frames where none is given.",
        unit="s",
        minimum=0.0001,
        maximum=60.0,
    )
    working_size: int = declared(
        40,
        "Targets whose sqrt(width * height) is above this are looked at in an image reduced by a "
        "whole factor that brings it to this or below, so the cost does not grow with the target.",
        unit="px",
        minimum=8,
        maximum=4096,
        read_only=True,
    )
    motion: MotionParameters = group(MotionParameters)
    proposal: ProposalParameters = group(ProposalParameters)
    resampling: ResamplingParameters = group(ResamplingParameters)
    adaptive_number: AdaptiveNumberParameters = group(AdaptiveNumberParameters)
    color_histogram: ColorHistogramParameters = group(ColorHistogramParameters)
    gradient_orientation: GradientOrientationParameters = group(GradientOrientationParameters)
    foreground_probability: ForegroundProbabilityParameters = group(ForegroundProbabilityParameters)
    moving_foreground: MovingForegroundParameters = group(MovingForegroundParameters)
    background: BackgroundParameters = group(BackgroundParameters)
    oriented_gradients: OrientedGradientsParameters = group(OrientedGradientsParameters)
    correlation_response: CorrelationResponseParameters = group(CorrelationResponseParameters)
    fusion: FusionParameters = group(FusionParameters)
    template: TemplateParameters = group(TemplateParameters)
    track: TrackParameters = group(TrackParameters)
    redetection: RedetectionParameters = group(RedetectionParameters)
