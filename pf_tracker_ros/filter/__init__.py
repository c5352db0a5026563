"""The particle filter: particles, motion models, proposals and resampling; no images here."""

from pf_tracker_ros.filter.affine_motion import AffineMotion
from pf_tracker_ros.filter.gaussian import DegenerateError, Gaussian
from pf_tracker_ros.filter.kalman_filter import KalmanFilter
from pf_tracker_ros.filter.motion import (
    LONGEST_PREDICTION,
    MOTION_MODELS,
    KalmanFilteredMotion,
    MotionModel,
    MotionParameters,
    SearchableMotion,
)
from pf_tracker_ros.filter.particles import ParticleSet
from pf_tracker_ros.filter.proposals import (
    CenterPrior,
    GridDensity,
    ProposalParameters,
    ProposedStates,
    SearchGrid,
    Transition,
    propose_from_prediction,
    propose_from_search,
    propose_from_transition,
)
from pf_tracker_ros.filter.resampling import (
    RESAMPLERS,
    EffectiveSampleSizeResampler,
    ElitistResampler,
    Resampler,
    ResamplingParameters,
    build_resampler,
)
from pf_tracker_ros.registry import import_all

__all__ = [
    "LONGEST_PREDICTION",
    "MOTION_MODELS",
    "RESAMPLERS",
    "AffineMotion",
    "CenterPrior",
    "DegenerateError",
    "EffectiveSampleSizeResampler",
    "ElitistResampler",
    "Gaussian",
    "GridDensity",
    "KalmanFilter",
    "KalmanFilteredMotion",
    "MotionModel",
    "MotionParameters",
    "ParticleSet",
    "ProposalParameters",
    "ProposedStates",
    "Resampler",
    "ResamplingParameters",
    "SearchGrid",
    "SearchableMotion",
    "Transition",
    "build_resampler",
    "propose_from_prediction",
    "propose_from_search",
    "propose_from_transition",
]

import_all(__name__, __path__)
