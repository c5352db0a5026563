"""Which cues there are."""

from __future__ import annotations

from pf_tracker_ros.cues import (
    ColorHistogram,
    CorrelationResponse,
    CueFusion,
    ForegroundProbability,
    GradientOrientation,
    MovingForeground,
    OrientedGradients,
)
from pf_tracker_ros.tracking.parameters import TrackerParameters


def build_fusion(parameters: TrackerParameters) -> CueFusion:
    """The fusion of all cues whose power is above 0.

    Raises:
        ParameterError: No power is above 0.
    """
    color, gradient = parameters.color_histogram, parameters.gradient_orientation
    foreground, outline = parameters.foreground_probability, parameters.oriented_gradients
    moving, correlation = parameters.moving_foreground, parameters.correlation_response
    return CueFusion(
        {
            "color_histogram": (ColorHistogram(color), color.power),
            "gradient_orientation": (GradientOrientation(gradient), gradient.power),
            "foreground_probability": (ForegroundProbability(foreground), foreground.power),
            "moving_foreground": (MovingForeground(moving), moving.power),
            "oriented_gradients": (OrientedGradients(outline), outline.power),
            "correlation_response": (CorrelationResponse(correlation), correlation.power),
        }
    )
