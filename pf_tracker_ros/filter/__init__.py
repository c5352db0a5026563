"""The particle filter: particles, motion models, proposals and resampling; no images here."""

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.motion import MOTION_MODELS, Box, MotionModel, MotionParameters
from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.filter.proposals import (
    Proposed,
    Transition,
    propose_from_prediction,
    propose_from_transition,
)
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
    "Gaussian",
    "MotionModel",
    "MotionParameters",
    "ParticleSet",
    "Proposed",
    "Resampler",
    "ResamplingParameters",
    "Transition",
    "propose_from_prediction",
    "propose_from_transition",
]
