"""Motion models: how the state goes on from one frame to the next, and which box it stands for.

Times are real: a model is told the seconds since the last frame, and its noise is a random walk
whose variance grows with them, so a tracker set up at 30 frames a second also works at 10. Noise
is given in box sizes, a box size being sqrt(width * height), so it suits near and far targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.affine_motion import AffineMotion
from pf_tracker_ros.filter.autoregressive import SecondOrderAutoregressive
from pf_tracker_ros.filter.foresight import SMALLEST_SPREAD, KalmanForesight
from pf_tracker_ros.filter.limits import limited_centers, limited_sizes
from pf_tracker_ros.filter.proposals import CenterPrior
from pf_tracker_ros.parameters import declared

Box = tuple[float, float, float, float]


class MotionModel(Protocol):
    """Owns the meaning of the state's columns; columns 0 and 1 are the box's center in pixels."""

    columns: tuple[str, ...]

    def prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """(count, D) states drawn from the Gaussian prior around the first box."""

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """(N, D) states drawn from the transition prior, `interval` seconds after `states`."""

    def constrained(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """(N, D) states with the centers inside an image of (width, height) and sane sizes."""

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes (x, y, width, height) in pixels of (N, D) states."""

    def center_prior(self, states: NDArray[np.float64], interval: float) -> CenterPrior | None:
        """Where `predict` takes the centers of (N, D) states, if the model can tell."""
        return None

    def foresight(self) -> KalmanForesight | None:
        """A Kalman filter that predicts the state from the first frame on, if the model has one."""


class ConstantVelocity:
    """State (x, y, vx, vy) in pixels and pixels per second; the box keeps its size.

    Source: Li et al. 2007, equation (3), with Phi for an interval of any length.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Noise and prior.
    """

    columns: tuple[str, ...] = ("x", "y", "velocity_x", "velocity_y")

    def __init__(self, box: Box, parameters: MotionParameters) -> None:
        x, y, width, height = box
        self._center = np.array([x + width / 2, y + height / 2])
        self._size = np.array([width, height])
        self._parameters = parameters
        self._noise = np.repeat([parameters.position_noise, parameters.velocity_noise], 2)

    def prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.prior`; source: Li et al. 2007, section 3."""
        spread = np.sqrt(self._size.prod()) * np.repeat(
            [self._parameters.prior_position, self._parameters.prior_velocity], 2
        )
        states = generator.standard_normal((count, 4)) * spread
        states[:, :2] += self._center
        return states

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Li et al. 2007, equation (3)."""
        noise = generator.standard_normal((len(states), 4))
        noise *= np.sqrt(interval) * self._box_sizes(states)
        noise *= self._noise
        predicted = states.copy()
        predicted[:, :2] += states[:, 2:4] * interval
        predicted[:, 2:4] *= np.exp(-self._parameters.velocity_damping * interval)
        predicted[:, :4] += noise
        return predicted

    def center_prior(self, states: NDArray[np.float64], interval: float) -> CenterPrior:
        """See `MotionModel.center_prior`."""
        mean = states[:, :2] + states[:, 2:4] * interval
        spread = self._parameters.position_noise * np.sqrt(interval) * self._box_sizes(states)
        return CenterPrior(mean, np.maximum(spread, SMALLEST_SPREAD))

    def constrained(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrained`."""
        constrained = states.copy()
        constrained[:, :2] = limited_centers(states[:, :2], image_size)
        return constrained

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        boxes = np.empty((len(states), 4))
        boxes[:, 2:] = self._size
        boxes[:, :2] = states[:, :2] - self._size / 2
        return boxes

    def foresight(self) -> None:
        """See `MotionModel.foresight`; the particles carry the velocity themselves."""
        return None

    def _box_sizes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 1) square roots of the boxes' areas, or one (1,) for all."""
        return np.sqrt(self._size.prod(keepdims=True))


class ConstantVelocityAndSize(ConstantVelocity):
    """State (x, y, vx, vy, width, height): constant velocity, the size a geometric random walk.

    The logarithms of the box size and of its aspect ratio walk on their own, since a target that
    comes nearer changes its size but seldom its shape.
    """

    columns: tuple[str, ...] = (*ConstantVelocity.columns, "width", "height")

    def prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.prior`."""
        sizes = np.broadcast_to(self._size, (count, 2))
        return np.hstack([super().prior(count, generator), sizes])

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`."""
        predicted = super().predict(states, interval, generator)
        walk = generator.standard_normal((2, len(states))) * np.sqrt(interval)
        log_size = self._parameters.size_noise * walk[0]
        log_aspect = self._parameters.aspect_noise * walk[1]
        predicted[:, 4] *= np.exp(log_size + log_aspect / 2)
        predicted[:, 5] *= np.exp(log_size - log_aspect / 2)
        return predicted

    def constrained(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrained`; sides as `limited_sizes` allows."""
        constrained = super().constrained(states, image_size)
        constrained[:, 4:6] = limited_sizes(states[:, 4:6], self._size, image_size)
        return constrained

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        return np.hstack([states[:, :2] - states[:, 4:6] / 2, states[:, 4:6]])

    def _box_sizes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(states[:, 4:5] * states[:, 5:6])


MOTION_MODELS: Mapping[str, Callable[[Box, MotionParameters], MotionModel]] = MappingProxyType(
    {
        "constant_velocity": ConstantVelocity,
        "constant_velocity_and_size": ConstantVelocityAndSize,
        "affine": AffineMotion,
        "second_order_autoregressive": SecondOrderAutoregressive,
    }
)

MODELS_WITH_CENTER_PRIOR = ("constant_velocity", "constant_velocity_and_size")
MODELS_WITH_FORESIGHT = ("affine", "second_order_autoregressive")


@dataclass(frozen=True)
class MotionParameters:
    """The motion model and its noise."""

    model: str = declared(
        "constant_velocity",
        "Motion model: constant_velocity keeps the box size of the first frame, "
        "constant_velocity_and_size lets it change, affine takes a factor and a drift of place and "
        "scale, "
        "second_order_autoregressive draws position and size from those of the last two steps.",
        choices=tuple(MOTION_MODELS),
        read_only=True,
    )
    position_noise: float = declared(
        1.0,
        "Random walk of the position; raise it for jerky motion.",
        unit="box sizes per square root of a second",
        minimum=0.0,
        maximum=50.0,
    )
    velocity_noise: float = declared(
        0.9,
        "Random walk of the velocity; raise it for targets that turn and brake.",
        unit="box sizes per second per square root of a second",
        minimum=0.0,
        maximum=500.0,
    )
    velocity_damping: float = declared(
        0.0,
        "Rate at which a velocity fades; 0 keeps it, as a constant velocity means.",
        unit="1/s",
        minimum=0.0,
        maximum=100.0,
    )
    size_noise: float = declared(
        0.1,
        "Random walk of the logarithm of the size, where the model has a size.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )
    aspect_noise: float = declared(
        0.03,
        "Random walk of the logarithm of width / height, where the model has a size.",
        unit="per square root of a second",
        minimum=0.0,
        maximum=10.0,
    )
    prior_position: float = declared(
        0.05,
        "Standard deviation of the Gaussian prior's position around the first box.",
        unit="box sizes",
        minimum=0.0,
        maximum=10.0,
    )
    prior_velocity: float = declared(
        0.5,
        "Standard deviation of the Gaussian prior's velocity around zero.",
        unit="box sizes per second",
        minimum=0.0,
        maximum=100.0,
    )
    first_coefficient: float = declared(
        1.5,
        "Weight of the last offset from the first box in second-order autoregressive motion (A1).",
        minimum=-3.0,
        maximum=3.0,
    )
    second_coefficient: float = declared(
        -0.5,
        "Weight of the last offset but one in second-order autoregressive motion (A2).",
        minimum=-3.0,
        maximum=3.0,
    )
    affine_factor: float = declared(
        1.0,
        "Factor of the last offset from the first box in affine motion (a): 1 keeps it, less pulls "
        "position and size back.",
        minimum=0.0,
        maximum=1.5,
    )
    affine_drift_x: float = declared(
        0.0,
        "Steady motion to the right in affine motion (b, over one step).",
        unit="box sizes per second",
        minimum=-100.0,
        maximum=100.0,
    )
    affine_drift_y: float = declared(
        0.0,
        "Steady motion downwards in affine motion (b, over one step).",
        unit="box sizes per second",
        minimum=-100.0,
        maximum=100.0,
    )
    model_step: float = declared(
        0.04,
        "Time that one step of affine or second-order autoregressive motion stands for; "
        "other times between frames take a power of it.",
        unit="s",
        minimum=0.0001,
        maximum=60.0,
        read_only=True,
    )
