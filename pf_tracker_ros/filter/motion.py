"""Motion models: how the state goes on from one frame to the next, and which box it stands for.

Times are real: a model is told the seconds since the last frame, and its noise is a random walk
whose variance grows with them, so a tracker set up at 30 frames a second also works at 10. Noise
is given in box sizes, a box size being sqrt(width * height), so it suits near and far targets.

Each model registers itself in `MOTION_MODELS`, with the parameters that it reads.
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
# Seconds that one step of an equation of motion stands for, where it counts steps and not time.
MODEL_STEP = 0.04
# So many steps of a motion model at once are an age; more would overflow where it diverges.
_MOST_STEPS = 200.0
# Seconds after which a prediction covers all that can be; numbers would overflow in the end.
LONGEST_PREDICTION = 60.0


def model_steps(interval: float) -> float:
    """How many steps of an equation of motion an interval in seconds is, if not an age."""
    return min(interval / MODEL_STEP, _MOST_STEPS)


def limit_centers(states: NDArray[np.float64], image_size: tuple[int, int]) -> NDArray[np.float64]:
    """(N, D) states with the centers, columns 0 and 1, moved into an image of (width, height)."""
    limited = states.copy()
    # Column by column: over many rows of two numbers it would take five times as long.
    for axis, length in enumerate(image_size):
        centers = limited[:, axis]
        np.maximum(centers, 0.0, out=centers)
        np.minimum(centers, length, out=centers)
    return limited


def limit_sizes(
    sizes: NDArray[np.float64], first_size: ArrayLike, image_size: tuple[int, int]
) -> NDArray[np.float64]:
    """(N, 2) sizes brought between `SMALLEST_SIDE` and the image's.

    A target whose first (width, height) is smaller may stay so.
    """
    smallest = np.minimum(SMALLEST_SIDE, first_size)
    return np.minimum(np.maximum(sizes, smallest), np.maximum(image_size, smallest))


# Standard deviation of the prior's position around the first box, box sizes: as well as a hand, or
# a detector, draws it.
PRIOR_POSITION_STD = 0.05
# That of the prior's velocity around rest, box sizes per second.
PRIOR_VELOCITY_STD = 0.5


class MotionModel(Protocol):
    """Owns the meaning of the state's columns; columns 0 and 1 are the box's center in pixels.

    A model is made of the first box, (x, y, width, height) in pixels, and of its parameters.
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
        """(N, D) states with the centers inside an image of (width, height) and sane sizes."""

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes (x, y, width, height) in pixels of (N, D) states."""


class SearchableMotion(MotionModel, Protocol):
    """A model that tells where it takes a center, so that a search can draw centers beside it."""

    def center_prior(self, states: NDArray[np.float64], interval: float) -> CenterPrior:
        """Where `predict` takes the centers of (N, D) states."""

    def random_walk_std(self, seconds: float) -> float:
        """Standard deviation of the center's random walk within a time, box sizes."""


class KalmanFilteredMotion(MotionModel, Protocol):
    """A model that a Kalman filter can run ahead of."""

    def kalman_filter(self) -> KalmanFilter:
        """The Kalman filter for the first frame: at the first box, at rest."""


MOTION_MODELS = Registry[MotionModel](
    "motion model", group="pf_tracker_ros.motion_models", prefix=""
)


def models_with(capability: str) -> tuple[str, ...]:
    """Names of the models that have a method."""
    return tuple(name for name, model in MOTION_MODELS.items() if hasattr(model, capability))


@dataclass(frozen=True)
class MotionParameters:
    """The motion model and its noise."""

    model: str = declared(
        "constant_velocity",
        "Motion model: constant_velocity keeps the box size of the first frame, "
        "constant_velocity_and_size lets it change, affine takes a factor and a drift of place and "
        "scale, second_order_autoregressive draws position and size from those of the last two "
        "steps.",
        choices=MOTION_MODELS,
        read_only=True,
    )
    of_models: dict[str, Any] = parts("model", MOTION_MODELS)


def declared_position_noise() -> float:
    """The parameter that every model has."""
    noise: float = declared(
        1.0,
        "Random walk of the position; raise it for jerky motion.",
        unit="box sizes per square root of a second",
        minimum=0.0,
        maximum=50.0,
    )
    return noise


def declared_velocity_noise() -> float:
    """The parameter of models with a velocity."""
    noise: float = declared(
        0.9,
        "Random walk of the velocity; raise it for targets that turn and brake.",
        unit="box sizes per second per square root of a second",
        minimum=0.0,
        maximum=500.0,
    )
    return noise


def declared_size_noise() -> float:
    """The parameter of models with a size."""
    noise: float = declared(
        0.1,
        "Random walk of the logarithm of the size.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )
    return noise


def declared_aspect_noise() -> float:
    """The parameter of models with a width and a height."""
    noise: float = declared(
        0.03,
        "Random walk of the logarithm of width / height.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )
    return noise
