"""The tracker of one target: a `TrackManager` that holds one."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, build
from pf_tracker_ros.targets.track_manager import TrackManager
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.input_checks import check_box, check_image, check_interval
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters


class Tracker:
    """Tracks one target.

    The same frames, box, parameters and seed give the same estimates, to the bit, on one machine;
    beyond ten thousand particles with one number of threads for NumPy's linear algebra.

    A tracker can be copied and pickled, with its target: the copy goes on with the same bits and on
    its own. `copy.copy` is as deep as `copy.deepcopy`, since two trackers cannot share a background
    model that learns, or a source of randomness. Unpickle with the same version of this package.
    Trackers are compared by identity; compare their estimates.

    Args:
        parameters: Every tunable, for one target.
        seed: Seeds all randomness; each `start` begins the sequence anew.

    Raises:
        ParameterError: The parameters contradict each other, or are for several targets.
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, TrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use Tracker.from_preset(name)"
            )
        if parameters.max_targets != 1:
            raise ParameterError(
                f"parameter 'max_targets' is {parameters.max_targets}; allowed: 1, as a Tracker "
                "has one target (a MultiTracker has several)"
            )
        self._manager = TrackManager(parameters, seed)

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
        return bool(self._manager.targets)

    @property
    def estimate(self) -> Estimate | None:
        """The last estimate, None before `start`."""
        targets = self._manager.targets
        return targets[0].estimate if targets else None

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return self._manager.parameters

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Change parameters, all or none, without losing the target.

        What decides on how a target is described, such as the motion model, learns it again from
        where it was last seen.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, or values contradict each other; or the
                target would have to be learned again and was not seen since, as in a fresh copy.
        """
        values = {**self.parameters, **values}
        other = type(self)(build(TrackerParameters, values), self._manager.seed)
        self._manager.adopt_parameters(other._manager)

    def start(self, image: NDArray[np.generic], box: ArrayLike) -> Estimate:
        """Take a new target, in the place of the one before.

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
        check_image(image)
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        self._manager.start_on(Frame(image.copy()), first_box)
        return self._manager.targets[0].estimate

    def stop(self) -> None:
        """Forget the target."""
        self._manager.reset()

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
        if not self.started:
            raise RuntimeError("no target: call start(image, box) first")
        check_image(image)
        if not self._manager.accepts_image(image):
            raise ValueError(self._manager.image_mismatch(image))
        self._manager.update(Frame(image.copy()), None if dt is None else check_interval(dt))
        return self._manager.targets[0].estimate

    def map_likelihood(self) -> LikelihoodMap | None:
        """How likely the target is at each place around its box, in the frame given last.

        Nothing is tracked by it. None without a target, and in a copy without that frame.
        """
        targets = self._manager.targets
        return self._manager.map_likelihood(targets[0].id) if targets else None
