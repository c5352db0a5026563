"""The multi-target tracker: targets are started and corrected by calls or by a detector."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.frames import Frame, check_image
from pf_tracker_ros.parameters import build
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.association import require_scipy
from pf_tracker_ros.targets.detections import Detections, StampedDetections
from pf_tracker_ros.targets.track_manager import TrackManager
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.frame_clock import NOMINAL_INTERVAL
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.input_checks import check_box, check_seconds, check_share
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

DEFAULT_MAX_TARGETS = 32
"""Value of `max_targets` where it is not given."""
# Bounds of the frame buffer for late detections: frames, and 10^6 bytes of images.
_BUFFER_BOUNDS = (1000, 128.0)
# Stamp of the first frame, nanoseconds; later stamps add the intervals.
_FIRST_STAMP = 10**18
# Longest interval and age, seconds, so that stamps stay finite.
_MAX_SECONDS = 1e8


class MultiTracker:
    """Tracks several targets; a detector of any rate and `start` start and correct them.

    All targets are tracked in every frame, also between the detector's frames. Late detections are
    applied at their own time stamp.

    Reproducible: the same frames, detections, parameters and seed give bit-identical ids and boxes
    on one machine. A copy or pickle has the targets but no buffered frames.

    Attributes:
        rejected_detections: Why detections of the last update were rejected.

    Args:
        parameters: All parameters.
        seed: Seeds all randomness.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no integer from 0.

    Example:
        A detector starts one target; the other one is drawn by hand:

        >>> import numpy as np
        >>> from pf_tracker_ros import Detections, MultiTracker
        >>> image = np.random.default_rng(1).integers(0, 256, (30, 40, 3), np.uint8)
        >>> image = image.repeat(8, axis=0).repeat(8, axis=1)
        >>> tracker = MultiTracker.from_preset("default", seed=0, parameters={"max_targets": 8})
        >>> tracker.start(image, (200, 120, 40, 48), label="bag")
        1
        >>> found = Detections([(40, 40, 48, 96)], [0.9], ["person"])
        >>> for _ in range(3):
        ...     targets = tracker.update(image, dt=0.2, detections=found)
        >>> [(target.id, target.label, target.estimate.state) for target in targets]
        [(1, 'bag', 'tracking'), (2, 'person', 'tracking')]
        >>> tracker.stop(1)
        >>> [target.id for target in tracker.targets]
        [2]
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, TrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use MultiTracker.from_preset(name)"
            )
        self._manager = TrackManager(parameters, seed)
        self._manager.frames.limit(*_BUFFER_BOUNDS)
        # Of the last frame; 0 before the first.
        self._stamp = 0

    def __copy__(self) -> MultiTracker:
        return copy.deepcopy(self)

    @classmethod
    def from_preset(
        cls, preset: str, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> MultiTracker:
        """Create a tracker with the parameters of a preset for several targets.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value; overrides the preset. `max_targets` is 32 by
                default.

        Raises:
            ParameterError: The preset or a parameter does not exist, or a value is not allowed.
            ValueError: The seed is no integer from 0.
        """
        values = {**preset_parameters(preset, DEFAULT_MAX_TARGETS), **(parameters or {})}
        return cls(build(TrackerParameters, values), seed)

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return self._manager.parameters

    @property
    def rejected_detections(self) -> tuple[str, ...]:  # noqa: D102
        return self._manager.rejected_detections

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Change parameters, all or none, and keep the targets with their ids.

        Some changes, such as another motion model, relearn every target where it was last seen.
        They also clear the frame buffer, so late detections of earlier frames are rejected.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, or values contradict each other; or a
                target must be relearned, and no stored frame shows it, as in a new copy.
        """
        values = {**self.parameters, **values}
        other = TrackManager(build(TrackerParameters, values), self._manager.seed)
        self._manager.adopt_parameters(other)

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The reported targets after the last frame, sorted by id."""
        return self._manager.targets

    def start(self, image: NDArray[np.generic], box: ArrayLike, label: str = "") -> int:
        """Start a manual target; no detector ends it.

        A box on an existing target that is not lost replaces that target and keeps its id.

        Args:
            image: The last one passed to `update`, or the first one; as for `Tracker.start`.
            box: (x, y, width, height) of the target in pixels, as for `Tracker.start`.
            label: Its class, or an empty text.

        Returns:
            Its id, never reused.

        Raises:
            ValueError: The image, the box or the label is invalid, or there are `max_targets`
                targets; nothing changes.
        """
        check_image(image)
        if not isinstance(label, str):
            raise ValueError(f"label is {label!r}; allowed: a text")
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        manager, last = self._manager, self._manager.last_frame
        if not manager.accepts_image(image):
            raise ValueError(manager.image_mismatch(image))
        if last is None and self._stamp:
            raise ValueError("there is no frame yet, as in a new copy; pass one to update first")
        if last and not np.array_equal(last.image, image, equal_nan=image.dtype.kind == "f"):
            raise ValueError(
                "image is not the last one passed to update; pass it to update first, then start "
                "on it"
            )
        if last is None:
            self._stamp = _FIRST_STAMP
            return manager.start_on(Frame(image.copy(), self._stamp), first_box, label).id
        return manager.start(first_box, label=label).id

    def stop(self, id: int) -> None:
        """Remove a target; a detector that still finds it starts it with a new id.

        Args:
            id: Of the target.

        Raises:
            ValueError: No target has this id; the message lists the ids.
        """
        self._manager.stop(id)

    def update(
        self,
        image: NDArray[np.generic],
        dt: float | None = None,
        detections: Detections | Sequence[Detections] | None = None,
        *,
        covered_shares: Mapping[int, float] | None = None,
    ) -> tuple[TrackedTarget, ...]:
        """Update all targets with the next frame.

        Args:
            image: As for `Tracker.start`; always of the same type and, within 1 %, the same aspect
                ratio. If the size changes, targets are rescaled, and late detections of earlier
                frames are rejected.
            dt: Seconds since the last frame; None means the nominal interval, 0.04 s.
            detections: Of this frame, or of an earlier one by their age; one or several, or None
                without a new detector result. Invalid ones are listed in `rejected_detections`.
            covered_shares: Id of a target to its `covered_share`, see `Tracker.update`; other ids
                are ignored.

        Returns:
            The reported targets, sorted by id.

        Raises:
            ValueError: The image, `dt`, the type of `detections` or a share is invalid; the state
                is unchanged.
        """
        check_image(image)
        batches = _as_list(detections)
        if batches:
            require_scipy()
        interval = NOMINAL_INTERVAL if dt is None else check_seconds(dt, "dt")
        stamp = _FIRST_STAMP
        if self._stamp:
            # Stamps always increase, also with `dt` 0.
            stamp = self._stamp + max(round(min(interval, _MAX_SECONDS) * NANOSECONDS), 1)
        stamped = [
            StampedDetections(one, stamp - round(min(one.age, _MAX_SECONDS) * NANOSECONDS))
            for one in batches
        ]
        if not isinstance(covered_shares, Mapping | None):
            raise ValueError(
                f"covered_shares is {covered_shares!r}; allowed: a mapping from ids to shares"
            )
        hints = {id: Hint(check_share(share)) for id, share in (covered_shares or {}).items()}
        self._manager.update(Frame(image.copy(), stamp), interval, stamped, hints)
        self._stamp = stamp
        return self.targets


def _as_list(detections: object) -> list[Detections]:
    """Detections, several or None as a list.

    Raises:
        ValueError: The type is another one.
    """
    if detections is None:
        return []
    batches: list[Any] = list(detections) if isinstance(detections, list | tuple) else [detections]
    for one in batches:
        if not isinstance(one, Detections):
            raise ValueError(
                f"detections are a {type(one).__name__}; expected "
                "Detections(boxes, scores, labels, age), a list of them, or None without a "
                "detector result"
            )
    return batches
