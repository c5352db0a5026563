"""The tracker: one target, followed from image to image by a fused-cue particle filter."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.parameters import ParameterError, build, declarations, flatten
from pf_tracker_ros.tracking.estimate import Estimate, TrackState
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.input_checks import check_box, check_image, check_interval, check_seed
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.scene import Scene
from pf_tracker_ros.tracking.target import Target

# Seconds from one frame to the next where nobody tells.
NOMINAL_INTERVAL = 0.04


class Tracker:
    """Tracks one target.

    The same frames, box, parameters and seed give the same estimates, to the bit, on one machine;
    beyond ten thousand particles with one number of threads for NumPy's linear algebra.

    A tracker can be copied and pickled, with its target: the copy goes on with the same bits and on
    its own. `copy.copy` is as deep as `copy.deepcopy`, since two trackers cannot share a background
    model that learns, or a source of randomness. Unpickle with the same version of this package.
    Trackers are compared by identity; compare their estimates.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness; each `start` begins the sequence anew.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, TrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use Tracker.from_preset(name)"
            )
        self._seed = check_seed(seed)
        self._tracked: _Tracked | None = None
        with usual_arithmetic():
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
            ValueError: The seed is no whole number from 0.
        """
        values = {**preset_parameters(preset), **(parameters or {})}
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
            ParameterError: A name or value is not allowed, values contradict each other, or
                `forbid` tells why the target could not be kept.
        """
        values = {**self.parameters, **values}
        self.share_parameters(Tracker(build(TrackerParameters, values)))

    def share_parameters(self, other: Tracker) -> None:
        """Go on with the parameters of another tracker, sharing what both only read.

        Args:
            other: Whose parameters to take, and nothing else.

        Raises:
            ParameterError: As `set_parameters`.
        """
        if reason := self.forbid(other.parameters):
            raise ParameterError(reason)
        if self._tracked:
            with usual_arithmetic():
                self._tracked.scene.reconfigure(other._follower)
        self._follower = other._follower

    def forbid(self, values: Mapping[str, Any]) -> str:
        """Why the target could not be kept with other parameters; empty where it could.

        Args:
            values: Full name to value of every parameter.
        """
        if self._tracked is None:
            return ""
        before = self.parameters
        for name, one in declarations(TrackerParameters).items():
            if one.read_only and one.counts(before) and values[name] != before[name]:
                return f"parameter '{name}' can't change while a target is tracked; stop first"
        # Without any that knows the target, all there is would be taken for it.
        known = self._tracked.target.templates
        if not any(name in known and values[f"{name}.power"] > 0.0 for name in values["cues"]):
            return (
                "no cue in 'cues' has learned the target that is tracked; keep one that has until "
                "the others have, or stop first"
            )
        return ""

    def empty(self, seed: int) -> Tracker:
        """A tracker with the same parameters and no target; what both only read is shared.

        Args:
            seed: As in the constructor.
        """
        tracker = object.__new__(type(self))
        tracker._follower, tracker._seed, tracker._tracked = self._follower, seed, None
        return tracker

    def start(self, image: NDArray[np.generic], box: ArrayLike) -> Estimate:
        """Take a new target.

        Args:
            image: (H, W, 3) uint8 BGR, or gray, (H, W) uint8, uint16 or float32, of any values;
                those that are not finite count as black.
            box: (x, y, width, height) of the target in pixels, (x, y) the top-left corner counted
                from 0; its center inside the image.

        Returns:
            The estimate for this first frame: the box itself, with confidence 1.

        Raises:
            ValueError: The image or the box is not usable; a target from before is then kept.
        """
        return self._start(image, box, "tracking")

    def take_over(self, other: Tracker, image: NDArray[np.generic], box: ArrayLike) -> None:
        """Take the target of another tracker, learned anew from an image that shows it.

        A target that is hidden or lost there is so here, until a frame shows it.

        Args:
            other: Follows the target.
            image: As for `start`.
            box: Of the target in it, as for `start`.

        Raises:
            RuntimeError: The other has no target.
            ValueError: As `start`.
        """
        if other.estimate is None:
            raise RuntimeError("no target to take over: the other tracker has none")
        self._start(image, box, other.estimate.state)

    def _start(self, image: NDArray[np.generic], box: ArrayLike, state: TrackState) -> Estimate:
        check_image(image)
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        with usual_arithmetic():
            scene = Scene(self._follower, self._seed)
            number = scene.start(image, first_box, state)
            self._tracked = _Tracked(scene, number, image.shape, image.dtype)
        return self._tracked.target.estimate

    def fits(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and kind of those that the target is followed in."""
        tracked = self._tracked
        return tracked is not None and (image.shape, image.dtype) == (
            tracked.image_shape,
            tracked.image_type,
        )

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
        if not self.fits(image):
            raise ValueError(
                f"image is {image.shape} {image.dtype}, but the target was started on "
                f"{tracked.image_shape}; start again to change the image's size or kind"
            )
        interval = NOMINAL_INTERVAL if dt is None else check_interval(dt)
        with usual_arithmetic():
            tracked.scene.update(image, interval)
        return tracked.target.estimate

    def map_likelihood(self) -> LikelihoodMap | None:
        """How likely the target is at each place around its box, in the frame given last.

        Nothing is tracked by it. None without a target, and in a copy without that frame. The
        frame's image is read again, so it must not have been written to since it was given.
        """
        if self._tracked is None:
            return None
        with usual_arithmetic():
            return self._tracked.scene.map_likelihood(self._tracked.number)


class _Tracked(NamedTuple):
    """The one target of a scene.

    Attributes:
        scene: That it is in.
        number: Its id there.
        image_shape: Of every image.
        image_type: Of every image.
    """

    scene: Scene
    number: int
    image_shape: tuple[int, ...]
    image_type: np.dtype[Any]

    @property
    def target(self) -> Target:
        return self.scene.targets[self.number]


def usual_arithmetic() -> np.errstate:
    """NumPy's own error handling, whatever the program around it has set.

    Likelihoods far from the target vanish, which `numpy.seterr(all="raise")` would make an error.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
