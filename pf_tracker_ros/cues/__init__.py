"""Cues: what a box in the image looks like, compared with a template of the target."""

from pf_tracker_ros.cues.color_histogram import ColorHistogram, ColorHistogramParameters
from pf_tracker_ros.cues.correlation_response import (
    CorrelationResponse,
    CorrelationResponseParameters,
)
from pf_tracker_ros.cues.cue import Cue, Match, SearchableCue
from pf_tracker_ros.cues.foreground_probability import (
    ForegroundProbability,
    ForegroundProbabilityParameters,
)
from pf_tracker_ros.cues.fusion import CueFusion, FusionParameters, TemplateParameters
from pf_tracker_ros.cues.gradient_orientation import (
    GradientOrientation,
    GradientOrientationParameters,
)
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.cues.moving_foreground import MovingForeground, MovingForegroundParameters
from pf_tracker_ros.cues.oriented_gradients import OrientedGradients, OrientedGradientsParameters

__all__ = [
    "ColorHistogram",
    "ColorHistogramParameters",
    "CorrelationResponse",
    "CorrelationResponseParameters",
    "Cue",
    "CueFusion",
    "ForegroundProbability",
    "ForegroundProbabilityParameters",
    "FrameMaps",
    "FusionParameters",
    "GradientOrientation",
    "GradientOrientationParameters",
    "Match",
    "MovingForeground",
    "MovingForegroundParameters",
    "OrientedGradients",
    "OrientedGradientsParameters",
    "SearchableCue",
    "TemplateParameters",
]
