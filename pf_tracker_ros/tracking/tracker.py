"""The tracker: one target, followed from image to image by a fused-cue particle filter."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.parameters import ParameterError, build, declarations, flatten
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.image import (
    adapted_range,
    check_box,
    check_image,
    check_interval,
    gray_range,
    to_8_bit,
)
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.target import Target


class _Tracked(NamedTuple):
    """A target and the kind of images that it is in; a frame replaces both or neither.

    Attributes:
        target: In the last image.
        image_shape: Of every image.
        gray_range: Values of a 16-bit image that become 0 and 255; None for 8-bit ones.
    """

    target: Target
    image_shape: tuple[int, ...]
    gray_range: tuple[float, float] | None


class Tracker:
    """Tracks one target.

    The same frames, box, parameters and seed give the same estimates, to the bit, on one machine.

    A tracker can be copied and pickled, with its target: the copy goes on with the same bits and on
    its own. `copy.copy` is as deep as `copy.deepcopy`, since two trackers cannot share a background
    model that learns, or a source of randomness. Unpickle with the same version of this package.
    Trackers are compared by identity; compare their estimates.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness; each `start` begins the sequence anew.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        self._seed = seed
        self._tracked: _Tracked | None = None
        self._generator = np.random.default_rng(seed)
        with _usual_arithmetic():
            self._follower = Follower(parameters)

    def __copy__(self) -> Tracker:
        return copy.deepcopy(self)

    @classmethod
    def from_preset(
        cls, preset: str, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> Tracker:
        """A tracker with the parameters of a preset.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value, over the preset's.

        Raises:
            ParameterError: No such preset or parameter, or a value that is not allowed.
        """
        values = preset_parameters(preset) | dict(parameters or {})
        return cls(build(TrackerParameters, values), seed)

    @property
    def started(self) -> bool:
        """Whether there is a target to track."""
        return self._tracked is not None

    @property
    def estimate(self) -> Estimate | None:
        """The last estimate, None before `start`."""
        return self._tracked.target.estimate if self._tracked else None

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._follower.parameters)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Change parameters, all or none, without losing the target.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, values contradict each other, or a
                read-only parameter would change while there is a target.
        """
        before = self.parameters
        parameters = build(TrackerParameters, before | dict(values))
        if self.started:
            known = declarations(TrackerParameters)
            for name, value in flatten(parameters).items():
                if known[name].read_only and value != before[name]:
                    raise ParameterError(
                        f"parameter '{name}' can't change while a target is tracked; stop first"
                    )
        with _usual_arithmetic():
            follower = Follower(parameters)
            if self._tracked:
                target = follower.reconfigured(self._tracked.target)
                self._tracked = self._tracked._replace(target=target)
        self._follower = follower

    def start(self, image: NDArray[np.generic], box: ArrayLike) -> Estimate:
        """Take a new target.

        Args:
            image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
            box: (x, y, width, height) of the target in pixels, (x, y) the top-left corner counted
                from 0; its center inside the image.

        Returns:
            The estimate for this first frame: the box itself, with confidence 1.

        Raises:
            ValueError: The image or the box is not usable; a target from before is then kept.
        """
        check_image(image)
        height, width = image.shape[:2]
        first_box = check_box(box, (width, height))
        generator = np.random.default_rng(self._seed)
        with _usual_arithmetic():
            span = gray_range(image)
            target = self._follower.begun(to_8_bit(image, span), first_box, generator)
        self._generator = generator
        self._tracked = _Tracked(target, image.shape, span)
        return target.estimate

    def stop(self) -> None:
        """Forget the target."""
        self._tracked = None

    def update(self, image: NDArray[np.generic], dt: float | None = None) -> Estimate:
        """Follow the target into the next frame.

        Args:
            image: As for `start`, of the same size and kind.
            dt: Seconds since the last frame; None means the nominal interval.

        Returns:
            What is now known of the target.

        Raises:
            RuntimeError: There is no target; call `start` first.
            ValueError: The image or `dt` is not usable; the last good state is kept.
        """
        tracked = self._tracked
        if tracked is None:
            raise RuntimeError("no target: call start(image, box) first")
        check_image(image)
        if image.shape != tracked.image_shape or (image.dtype == np.uint16) != bool(
            tracked.gray_range
        ):
            raise ValueError(
                f"image is {image.shape} {image.dtype}, but the target was started on "
                f"{tracked.image_shape}; start again to change the image's size or kind"
            )
        nominal = self._follower.parameters.nominal_interval
        interval = nominal if dt is None else check_interval(dt)
        with _usual_arithmetic():
            span = adapted_range(tracked.gray_range, image, interval)
            target = self._follower.followed(
                tracked.target, to_8_bit(image, span), interval, self._generator
            )
        self._tracked = tracked._replace(target=target, gray_range=span)
        return target.estimate


def _usual_arithmetic() -> np.errstate:
    """NumPy's own error handling, whatever the program around it has set.

    Likelihoods far from the target vanish, which `numpy.seterr(all="raise")` would make an error.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
