"""The particle filter: particles, motion models, proposals and resampling; no images here."""

from pf_tracker_ros.filter.adaptive_number import (
    AdaptiveNumberParameters,
    AdaptiveResampler,
    particles_needed,
)
from pf_tracker_ros.filter.affine_motion import AffineMotion
from pf_tracker_ros.filter.foresight import KalmanForesight
from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.motion import (
    MODELS_WITH_CENTER_PRIOR,
    MODELS_WITH_FORESIGHT,
    MOTION_MODELS,
    Box,
    MotionModel,
    MotionParameters,
)
from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.filter.proposals import (
    CenterPrior,
    GridDensity,
    ProposalParameters,
    Proposed,
    SearchGrid,
    Transition,
    propose_from_prediction,
    propose_from_search,
    propose_from_transition,
)
from pf_tracker_ros.filter.resampling import (
    RESAMPLERS,
    BestKeepingResampler,
    EffectiveSampleSizeResampler,
    Resampler,
    ResamplingParameters,
    build_resampler,
    build_scheme,
)

__all__ = [
    "MODELS_WITH_CENTER_PRIOR",
    "MODELS_WITH_FORESIGHT",
    "MOTION_MODELS",
    "RESAMPLERS",
    "AdaptiveNumberParameters",
    "AdaptiveResampler",
    "AffineMotion",
    "BestKeepingResampler",
    "Box",
    "CenterPrior",
    "EffectiveSampleSizeResampler",
    "Gaussian",
    "GridDensity",
    "KalmanForesight",
    "MotionModel",
    "MotionParameters",
    "ParticleSet",
    "ProposalParameters",
    "Proposed",
    "Resampler",
    "ResamplingParameters",
    "SearchGrid",
    "Transition",
    "build_resampler",
    "build_scheme",
    "particles_needed",
    "propose_from_prediction",
    "propose_from_search",
    "propose_from_transition",
]
