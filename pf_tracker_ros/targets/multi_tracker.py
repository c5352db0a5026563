"""The tracker of several targets, started and corrected by hand or by a detector."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.association import require_scipy
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.out_of_sequence import StampedDetections
from pf_tracker_ros.targets.track_manager import NOMINAL_INTERVAL, TrackManager
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.input_checks import check_box, check_image, check_interval
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

DEFAULT_MAX_TARGETS = 32
"""Of several targets, where nobody says how many there may be."""
# Frames that are kept for late detections, and most memory for their images, in units of 10^6
# bytes.
_KEPT = (1000, 128.0)
# Of the first frame, nanoseconds; those after it are stamped by the time since the frame before.
# Nothing is further apart, in seconds: of an endless time there is no stamp.
_FIRST_STAMP, _LONGEST = 10**18, 1e8


class MultiTracker:
    """Tracks any number of targets, which a slow detector starts and corrects, or somebody by hand.

    Every frame is looked at, whether a detector saw it or not. A detection of an earlier frame is
    taken as if it had come in time: what happened since is worked out again.

    The same frames, detections, parameters and seed give the same ids and boxes, to the bit, on one
    machine. A tracker can be copied and pickled, with its targets but without the frames for late
    detections.

    Attributes:
        rejected_detections: Why detections of the last update were no use.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, TrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use MultiTracker.from_preset(name)"
            )
        self._manager = TrackManager(parameters, seed)
        self._manager.frames.limit(*_KEPT)
        # Of the last frame.
        self._stamp = 0

    def __copy__(self) -> MultiTracker:
        return copy.deepcopy(self)

    @classmethod
    def from_preset(
        cls, preset: str, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> MultiTracker:
        """A tracker with the parameters of a preset, as it suits several targets.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value, over the preset's; `max_targets` is 32 where
                it is not given.

        Raises:
            ParameterError: No such preset or parameter, or a value that is not allowed.
            ValueError: The seed is no whole number from 0.
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
        """Change parameters, all or none, keeping the targets with their ids.

        What decides on how a target is described, such as the motion model, learns every target
        again from where it was last seen; frames before the change are then gone for late
        detections.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, values contradict each other, or a
                target was never seen that would have to be learned again.
        """
        values = {**self.parameters, **values}
        other = TrackManager(build(TrackerParameters, values), self._manager.seed)
        self._manager.adopt_parameters(other)

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The targets as the last frame left them, in the order of their ids."""
        return self._manager.targets

    def start(self, image: NDArray[np.generic], box: ArrayLike, label: str = "") -> int:
        """Take a new target by hand; no detector ends it.

        A box on a target that there is, and that is not lost, takes that one over, with its id.

        Args:
            image: That was given to `update` last, or the first one: see `Tracker.start`.
            box: (x, y, width, height) of the target in pixels, as for `Tracker.start`.
            label: What it is.

        Returns:
            Its id, never that of another object.

        Raises:
            ValueError: The image, the box or the label is not usable, or there are as many targets
                as there may be; all are kept.
        """
        check_image(image)
        if not isinstance(label, str):
            raise ValueError(f"label is {label!r}; allowed: a text")
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        manager, last = self._manager, self._manager.last_frame
        if not manager.accepts_image(image):
            raise ValueError(manager.image_mismatch(image))
        if last is None and self._stamp:
            raise ValueError(
                "there is no frame so far, as in a fresh copy; give one to update first"
            )
        if last and not np.array_equal(last.image, image, equal_nan=image.dtype.kind == "f"):
            raise ValueError(
                "image is not the one that was given last; give it to update first, then start "
                "on it"
            )
        if last is None:
            self._stamp = _FIRST_STAMP
            return manager.start_on(Frame(image.copy(), self._stamp), first_box, label).id
        return manager.start(first_box, label=label).id

    def stop(self, id: int) -> None:
        """Forget a target.

        A detector that still sees it will start it again, with another id.

        Args:
            id: Of the target.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        self._manager.stop(id)

    def update(
        self,
        image: NDArray[np.generic],
        dt: float | None = None,
        detections: Detections | Sequence[Detections] | None = None,
    ) -> tuple[TrackedTarget, ...]:
        """Follow all targets into the next frame.

        Args:
            image: As for `Tracker.start`; of the same size and kind each time.
            dt: Seconds since the last frame; None means the nominal interval.
            detections: What a detector found in this frame, or in the earlier one that its age
                names, or several such answers; None where it has said nothing. `rejected_detections` tells
                what was no use in it.

        Returns:
            The targets that are sure enough, in the order of their ids.

        Raises:
            ValueError: The image, `dt` or what is given for detections is not usable; the last
                good state is kept.
        """
        check_image(image)
        if not self._manager.accepts_image(image):
            raise ValueError(self._manager.image_mismatch(image))
        answers = _answers(detections)
        if answers:
            require_scipy()
        interval = NOMINAL_INTERVAL if dt is None else check_interval(dt)
        stamp = _FIRST_STAMP
        if self._stamp:
            # Two frames at once are one after the other.
            stamp = self._stamp + max(round(min(interval, _LONGEST) * NANOSECONDS), 1)
        stamped = [
            StampedDetections(stamp - round(min(one.age, _LONGEST) * NANOSECONDS), one)
            for one in answers
        ]
        self._manager.update(Frame(image.copy(), stamp), interval, stamped)
        self._stamp = stamp
        return self.targets


def _answers(detections: object) -> list[Detections]:
    """What was given for detections, as a list.

    Raises:
        ValueError: It is something else.
    """
    if detections is None:
        return []
    given = detections if isinstance(detections, list | tuple) else [detections]
    answers: list[Detections] = []
    for one in given:
        if not isinstance(one, Detections):
            raise ValueError(
                f"detections are a {type(one).__name__}; expected "
                "Detections(boxes, scores, labels, age), several of them, or None where no "
                "detector ran"
            )
        answers.append(one)
    return answers
