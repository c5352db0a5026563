"""The particle filter: particles, motion models and resampling. It knows nothing of images."""

from pf_tracker_ros.filter.motion import MOTION_MODELS, Box, MotionModel, MotionParameters
from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.filter.resampling import (
    RESAMPLERS,
    EffectiveSampleSizeResampler,
    Resampler,
    ResamplingParameters,
)

__all__ = [
    "MOTION_MODELS",
    "RESAMPLERS",
    "Box",
    "EffectiveSampleSizeResampler",
    "MotionModel",
    "MotionParameters",
    "ParticleSet",
    "Resampler",
    "ResamplingParameters",
]
