"""Motion models: the transition prior p(x_k | x_{k-1}) of a target's state.

A motion model defines the columns of the state and

1. samples the prior p(x_0) around the first box (`sample_prior`);
2. samples the transition prior, x_k = f(x_{k-1}) + noise (`predict`);
3. keeps states inside the image (`constrain`);
4. converts states to boxes, which the cues compare with the image (`boxes`).

The interval between frames is in seconds. Noise is a random walk, so its variance grows in
proportion to the interval, and a model tuned at 30 frames per second also works at 10. Noise is in
box sizes, sqrt(width * height), so it suits near and far targets.

Each model registers itself in `MOTION_MODELS` with its parameters.

Source: Li et al. 2007, equation (1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.filter.kalman_filter import KalmanFilter
from pf_tracker_ros.filter.proposals import CenterPrior
from pf_tracker_ros.parameters import declared, parts
from pf_tracker_ros.registry import Registry

# Smaller boxes hold too few pixels to tell a target from its surroundings.
SMALLEST_SIDE = 6.0
# Of the image's: who stands before a robot does not fit into it.
_LARGEST_SIDE = 1.5
# Seconds in one step of a discrete equation of motion.
MODEL_STEP = 0.04
# Maximum number of steps in one prediction: a divergent model would overflow with more.
_MAX_STEPS = 200.0
# Longest interval of a prediction with any model, seconds. Discrete equations of motion stop
# earlier, after `_MAX_STEPS`.
LONGEST_PREDICTION = 60.0


def model_steps(interval: float) -> float:
    """Number of steps of a discrete equation of motion in an interval in seconds, limited."""
    return min(interval / MODEL_STEP, _MAX_STEPS)


def limit_centers(states: NDArray[np.float64], image_size: tuple[int, int]) -> NDArray[np.float64]:
    """(N, D) states with the centers, columns 0 and 1, moved into an image of (width, height)."""
    limited = states.copy()
    # By column: five times as fast as by rows of two numbers.
    for axis, length in enumerate(image_size):
        centers = limited[:, axis]
        np.maximum(centers, 0.0, out=centers)
        np.minimum(centers, length, out=centers)
    return limited


def limit_sizes(
    sizes: NDArray[np.float64], first_size: ArrayLike, image_size: tuple[int, int]
) -> NDArray[np.float64]:
    """(N, 2) sizes, limited.

    A side is at least the smaller of `SMALLEST_SIDE` and the first side, at most 1.5 times that of
    the image.
    """
    smallest = np.minimum(SMALLEST_SIDE, first_size)
    largest = _LARGEST_SIDE * np.asarray(image_size)
    return np.minimum(np.maximum(sizes, smallest), np.maximum(largest, smallest))


# Standard deviation of the prior's position in box sizes: the accuracy of a drawn or detected box.
PRIOR_POSITION_STD = 0.05
# Standard deviation of the prior's velocity, box sizes per second; its mean is 0.
PRIOR_VELOCITY_STD = 0.5


class MotionModel(Protocol):
    """Defines the state's columns; columns 0 and 1 are the box's center in pixels.

    It is constructed from the first box, (x, y, width, height) in pixels, and its parameters.
    """

    columns: tuple[str, ...]

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """(count, D) states drawn from the Gaussian prior around the first box."""

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """(N, D) states drawn from the transition prior, `interval` seconds after `states`."""

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """(N, D) states with centers inside an image of (width, height) and limited sizes."""

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes (x, y, width, height) in pixels of (N, D) states."""


class SearchableMotion(MotionModel, Protocol):
    """A model with a density of the predicted center, as the search proposal needs it."""

    def center_prior(self, states: NDArray[np.float64], interval: float) -> CenterPrior:
        """Density of the centers that `predict` draws for (N, D) states."""

    def random_walk_std(self, seconds: float) -> float:
        """Standard deviation of the center's random walk over a time, box sizes."""

    def with_boxes(
        self, states: NDArray[np.float64], boxes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N, D) states moved to (N, 4) boxes, as far as the model has their sizes."""


class KalmanFilteredMotion(MotionModel, Protocol):
    """A model with a Kalman filter, as the Kalman proposal needs it."""

    def kalman_filter(self) -> KalmanFilter:
        """The Kalman filter of the first frame: at the first box, at rest."""


MOTION_MODELS = Registry[MotionModel](
    "motion model", group="pf_tracker_ros.motion_models", prefix=""
)


def models_with(method: str) -> tuple[str, ...]:
    """Names of the models with a method called `method`."""
    return tuple(name for name, model in MOTION_MODELS.items() if hasattr(model, method))


@dataclass(frozen=True)
class MotionParameters:
    """The motion model and its noise."""

    model: str = declared(
        "constant_velocity",
        "Motion model: constant_velocity keeps the box size of the first frame, "
        "constant_velocity_and_size lets it change, affine applies a factor to position "
        "and scale and a drift to the position, second_order_autoregressive continues position "
        "and size from the last two steps.",
        choices=MOTION_MODELS,
        read_only=True,
    )
    of_models: dict[str, Any] = parts("model", MOTION_MODELS)


def declared_position_noise() -> float:
    """Parameter `position_noise`, which every model has."""
    return declared(
        1.0,
        "Random walk of the position; raise it for jerky motion.",
        unit="box sizes per square root of a second",
        minimum=0.0,
        maximum=50.0,
    )


def declared_velocity_noise() -> float:
    """Parameter `velocity_noise` of models with a velocity."""
    return declared(
        0.9,
        "Random walk of the velocity; raise it for targets that turn and brake.",
        unit="box sizes per second per square root of a second",
        minimum=0.0,
        maximum=500.0,
    )


def declared_size_noise() -> float:
    """Parameter `size_noise` of models with a size."""
    return declared(
        0.1,
        "Random walk of the logarithm of the size.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )


def declared_aspect_noise() -> float:
    """Parameter `aspect_noise` of models with a width and a height."""
    return declared(
        0.03,
        "Random walk of the logarithm of width / height.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )
