"""The single-target tracker: a `TrackManager` with `max_targets` 1."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.frames import Frame, check_image
from pf_tracker_ros.parameters import ParameterError, build
from pf_tracker_ros.targets.track_manager import TrackManager
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.input_checks import check_box, check_seconds, check_share
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters


class Tracker:
    """Tracks one target.

    Reproducible: the same frames, box, parameters and seed give bit-identical estimates on one
    machine. Above ten thousand particles this needs the same number of NumPy threads, too.

    A tracker can be copied and pickled with its target; the copy gives the same estimates and is
    independent. `copy.copy` is as deep as `copy.deepcopy`. Unpickle with the same version of this
    package. Trackers are compared by identity; compare their estimates instead.

    Args:
        parameters: All parameters, with `max_targets` 1.
        seed: Seeds all randomness; each `start` resets the random generator.

    Raises:
        ParameterError: The parameters contradict each other, or `max_targets` is not 1.
        ValueError: The seed is no integer from 0.

    Example:
        A textured patch of 40 x 30 pixels that moves to the right over a gray image:

        >>> import numpy as np
        >>> from pf_tracker_ros import Tracker
        >>> patch = np.random.default_rng(1).integers(0, 256, (6, 8, 3), np.uint8)
        >>> patch = patch.repeat(5, axis=0).repeat(5, axis=1)
        >>> def frame(x):
        ...     image = np.full((120, 160, 3), 90, np.uint8)
        ...     image[40:70, x : x + 40] = patch
        ...     return image
        >>> tracker = Tracker.from_preset("default", seed=0, parameters={"particles": 100})
        >>> first = tracker.start(frame(20), (20, 40, 40, 30))
        >>> for x in range(22, 62, 2):
        ...     estimate = tracker.update(frame(x), dt=0.04)
        >>> estimate.state, bool(abs(estimate.box[0] - 60) < 3)
        ('tracking', True)
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
        """Create a tracker with the parameters of a preset.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value; overrides the preset.

        Raises:
            ParameterError: The preset or a parameter does not exist, or a value is not allowed.
            ValueError: The seed is no integer from 0.
        """
        values = {**preset_parameters(preset), **(parameters or {})}
        return cls(build(TrackerParameters, values), seed)

    @property
    def started(self) -> bool:
        """Whether there is a target."""
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
        """Change parameters, all or none, and keep the target.

        Some changes, such as another motion model, relearn the target where it was last seen.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, or values contradict each other; or the
                target must be relearned, and no stored frame shows it, as in a new copy.
        """
        values = {**self.parameters, **values}
        other = type(self)(build(TrackerParameters, values), self._manager.seed)
        self._manager.adopt_parameters(other._manager)

    def start(self, image: NDArray[np.generic], box: ArrayLike) -> Estimate:
        """Start a new target; it replaces a former one.

        Args:
            image: (H, W, 3) uint8 BGR, or gray, (H, W) uint8, uint16 or float32, of any values;
                values that are not finite count as black.
            box: (x, y, width, height) of the target in pixels, (x, y) the top-left corner counted
                from 0; its center inside the image.

        Returns:
            The estimate for this first frame: the box itself, with confidence 1.

        Raises:
            ValueError: The image or the box is invalid; a former target is kept.
        """
        check_image(image)
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        self._manager.start_on(Frame(image.copy()), first_box)
        return self._manager.targets[0].estimate

    def stop(self) -> None:
        """Remove the target."""
        self._manager.reset()

    def update(
        self, image: NDArray[np.generic], dt: float | None = None, *, covered_share: float = 0.0
    ) -> Estimate:
        """Estimate the target in the next frame.

        Args:
            image: As for `start`, of the same type and, within 1 %, the same aspect ratio. If the
                size changes, the target is rescaled.
            dt: Seconds since the last frame; None means the nominal interval, 0.04 s.
            covered_share: Share, 0 to 1, of the box that something in front covers, where a depth
                camera or another sensor says so. It lowers the confidence of this frame, for at
                most two seconds at a time.

        Returns:
            The new estimate.

        Raises:
            RuntimeError: There is no target; call `start` first.
            ValueError: The image, `dt` or `covered_share` is invalid; the state is unchanged.
        """
        if not self.started:
            raise RuntimeError("no target: call start(image, box) first")
        check_image(image)
        interval = None if dt is None else check_seconds(dt, "dt")
        share = check_share(covered_share)
        hints = {target.id: Hint(share) for target in self._manager.targets} if share else None
        self._manager.update(Frame(image.copy()), interval, hints=hints)
        return self._manager.targets[0].estimate

    def map_likelihood(self) -> LikelihoodMap | None:
        """The likelihood around the target's box in the last frame; tracking is unaffected.

        None without a target, and in a new copy, which has no frame.
        """
        targets = self._manager.targets
        return self._manager.map_likelihood(targets[0].id) if targets else None
