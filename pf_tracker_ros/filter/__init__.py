"""The particle filter of one target's state; images appear only in `pf_tracker_ros.cues`.

A particle filter represents the posterior density p(x_k | z_1, ..., z_k) of the state x_k by N
weighted samples, the particles. In every frame it

1. draws the next state of every particle from a proposal, usually the motion model itself;
2. multiplies every weight by the likelihood p(z_k | x_k) of the image, and by the ratio of motion
   model to proposal where these differ, then normalizes;
3. estimates the state, as the weighted mean, and its covariance;
4. resamples when a few particles hold most of the weight.

To learn it from the code, read the modules in this order: particles, resampling, motion,
constant_velocity, autoregressive, affine_motion, kalman_filter (with gaussian) and proposals.
`pf_tracker_ros.tracking.target_filter` runs the loop.

Sources: Arulampalam et al. 2002, "A tutorial on particle filters for online nonlinear/non-Gaussian
Bayesian tracking"; Zhang et al. 2015, section 2.
"""

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
