"""The tracker of several targets, started and corrected by hand or by a detector."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import build, change, flatten
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.detections import DOUBLED_ABOVE, Detections, Sighting, sightings
from pf_tracker_ros.targets.geometry import overlaps
from pf_tracker_ros.targets.history import History, Moment
from pf_tracker_ros.targets.keeper import CrowdKeeper
from pf_tracker_ros.targets.life import Key, Life
from pf_tracker_ros.targets.parameters import MultiTrackerParameters, multi_preset_parameters
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.camera import Camera
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.input_checks import check_box, check_image, check_interval
from pf_tracker_ros.tracking.tracker import NOMINAL_INTERVAL, usual_arithmetic

# A target that a late detection has started in the place of another keeps the id of that one if
# they overlap by more than this.
_SAME_ABOVE = 0.5
# Names of targets that are remembered beyond those that there are.
_MOST_NAMES = 10_000


class MultiTracker:
    """Tracks any number of targets, which a slow detector starts and corrects, or somebody by hand.

    Every frame is looked at, whether a detector saw it or not. A detection of an earlier frame is
    taken as if it had come in time: what happened since is worked out again.

    The same frames, detections, parameters and seed give the same ids and boxes, to the bit, on one
    machine. A tracker can be copied and pickled, with its targets but without the frames for late
    detections.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness.

    Raises:
        ParameterError: The parameters contradict each other.
    """

    def __init__(self, parameters: MultiTrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, MultiTrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use MultiTracker.from_preset(name)"
            )
        self._parameters = parameters
        self._seed = seed
        with usual_arithmetic():
            self._follower = Follower(parameters)
        self._keeper = CrowdKeeper(self._follower, parameters, seed)
        self._camera = Camera(seed)
        self._crowd = Crowd()
        self._history = History()
        self._names: dict[Key, int] = {}
        self._last_name = 0
        self._shape: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self.left_out: tuple[str, ...] = ()

    def __copy__(self) -> MultiTracker:
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_history": History()}

    @classmethod
    def from_preset(
        cls, preset: str, seed: int = 0, parameters: Mapping[str, Any] | None = None
    ) -> MultiTracker:
        """A tracker with the parameters of a preset, as it suits several targets.

        Args:
            preset: A key of `PRESETS`.
            seed: As in the constructor.
            parameters: Full parameter name to value, over the preset's.

        Raises:
            ParameterError: No such preset or parameter, or a value that is not allowed.
        """
        values = multi_preset_parameters(preset)
        values = change(MultiTrackerParameters, values, parameters or {})
        return cls(build(MultiTrackerParameters, values), seed)

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The targets as the last frame left them, in the order of their ids."""
        told = [
            TrackedTarget(
                self._names[life.key],
                life.label,
                life.target.estimate,
                life.age,
                life.unconfirmed_for,
            )
            for life in self._crowd.lives
            if life.is_told and life.key in self._names
        ]
        return tuple(sorted(told, key=lambda target: target.id))

    def start(self, image: NDArray[np.generic], box: ArrayLike, label: str = "") -> int:
        """Take a new target by hand; no detector ends it.

        Args:
            image: That was given to `update` last, or the first one: see `Tracker.start`.
            box: (x, y, width, height) of the target in pixels, as for `Tracker.start`.
            label: What it is.

        Returns:
            Its id, never that of another.

        Raises:
            ValueError: The image, the box or the label is not usable; all targets are kept.
        """
        check_image(image)
        if not isinstance(label, str):
            raise ValueError(f"label is {label!r}; allowed: a text")
        first_box = check_box(box, (image.shape[1], image.shape[0]))
        if self._shape and self._shape != (image.shape, image.dtype):
            raise ValueError(self._misfit(image))
        with usual_arithmetic():
            frame = self._camera.frame
            if self._shape is None:
                # A copy, since the history keeps it while the caller may write to it.
                frame = self._open(image.copy(), 0.0, [first_box])
                self._history.add(Moment(frame, 0.0, self._crowd))
                self._crowd = self._keeper.advance(self._crowd, frame, 0.0, None)
            elif frame is None or not np.array_equal(frame.image, image):
                raise ValueError(
                    "image is not the one that was given last; give it to update first, then start "
                    "on it"
                )
            number = self._crowd.frame
            before = sum(key.place < 0 and key.frame == number for key in self._names)
            key = Key(number, -1 - before)
            life = self._keeper.initiator.begin(frame, first_box, key, label)
        self._keep(frame)
        self._crowd = replace(self._crowd, lives=(*self._crowd.lives, life))
        if len(self._history):
            last = self._history.last
            self._history.revise([replace(last, begun=(*last.begun, life))])
        self._name(life)
        return self._names[key]

    def stop(self, id: int) -> None:
        """Forget a target.

        A detector that still sees it will start it again, with another id.

        Args:
            id: Of the target.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        lives = {
            self._names.get(life.key): life for life in (*self._crowd.lives, *self._crowd.gone)
        }
        life = lives.get(id) if isinstance(id, int | np.integer) else None
        if life is None:
            known = ", ".join(str(target.id) for target in self.targets) or "none"
            raise ValueError(f"no target has the id {id!r}; there are: {known}")
        self._crowd = self._crowd.without(life.key)
        if len(self._history):
            last = self._history.last
            self._history.revise([replace(last, stopped=(*last.stopped, life.key))])

    def update(
        self,
        image: NDArray[np.generic],
        dt: float | None = None,
        detections: Detections | None = None,
    ) -> tuple[TrackedTarget, ...]:
        """Follow all targets into the next frame.

        Args:
            image: As for `Tracker.start`; of the same size and kind each time.
            dt: Seconds since the last frame; None means the nominal interval.
            detections: What a detector found in this frame, or in the earlier one that its age
                names; None where it has said nothing. `left_out` tells what was no use in it.

        Returns:
            The targets that are sure enough, in the order of their ids.

        Raises:
            ValueError: The image, `dt` or what is given for detections is not usable; the last
                good state is kept.
        """
        check_image(image)
        if self._shape and self._shape != (image.shape, image.dtype):
            raise ValueError(self._misfit(image))
        if detections is not None and not isinstance(detections, Detections):
            raise ValueError(
                f"detections are a {type(detections).__name__}; expected "
                "Detections(boxes, scores, labels, age), or None where no detector ran"
            )
        interval = NOMINAL_INTERVAL if dt is None else check_interval(dt)
        with usual_arithmetic():
            told = {self._names[life.key]: life for life in self._crowd.lives if self._tells(life)}
            frame = self._open(
                image.copy(), interval, [life.target.estimate.box for life in self._crowd.lives]
            )
            crowd, seen = self._crowd, None
            revised: list[Moment] = []
            left_out: list[str] = []
            if detections is not None:
                if detections.age <= interval / 2 or not len(self._history):
                    seen, left_out = self._sightings(detections, frame)
                else:
                    crowd, revised, left_out = self._look_back(detections, interval)
            moment = Moment(frame, interval, crowd, seen)
            crowd = self._keeper.advance(crowd, frame, interval, seen)
        self._keep(frame)
        self._history.revise(revised)
        self._history.add(moment)
        self._crowd, self.left_out = crowd, tuple(left_out)
        if revised:
            self._pass_on_names(told)
        for life in crowd.lives:
            if life.is_told:
                self._name(life)
        self._forget_names()
        return self.targets

    def _look_back(
        self, detections: Detections, interval: float
    ) -> tuple[Crowd, list[Moment], list[str]]:
        """The targets of the last frame, had late detections come in time.

        Args:
            detections: Of an earlier frame than the one at hand.
            interval: Seconds from the last frame to that.

        Returns:
            The targets, the moments that were worked out again, and what was left out.
        """
        moments = self._history.since(detections.age - interval)
        if moments is None:
            reason = (
                f"the detections are {detections.age:g} s old, and frames of the last "
                f"{self._history.seconds + interval:.2g} s are kept"
            )
            return self._crowd, [], [reason]
        first = moments[0]
        seen, left_out = self._sightings(detections, first.frame)
        moments[0] = replace(first, seen=(*_not_among(first.seen or (), seen), *(first.seen or ())))
        crowd = first.before
        revised = []
        for moment in moments:
            revised.append(replace(moment, before=crowd))
            crowd = self._keeper.advance(crowd, moment.frame, moment.interval, moment.seen)
            crowd = replace(crowd, lives=(*crowd.lives, *moment.begun))
            for key in moment.stopped:
                crowd = crowd.without(key)
        return crowd, revised, left_out

    def _sightings(
        self, detections: Detections, frame: Frame
    ) -> tuple[tuple[Sighting, ...], list[str]]:
        seen, reasons = sightings(detections, frame, self._parameters.detector.score_above)
        return tuple(seen), reasons

    def _tells(self, life: Life) -> bool:
        return life.is_told and life.key in self._names

    def _name(self, life: Life) -> None:
        if life.key not in self._names:
            self._last_name += 1
            self._names[life.key] = self._last_name

    def _pass_on_names(self, told: Mapping[int, Life]) -> None:
        """Let targets that took the places of others, when those were worked out again, be them."""
        there = {life.key for life in (*self._crowd.lives, *self._crowd.gone)}
        lost = [(name, life) for name, life in told.items() if life.key not in there]
        for life in self._crowd.lives:
            if not lost or not life.is_told or life.key in self._names:
                continue
            same = overlaps(life.box[None], np.array([one.box for _, one in lost]))[0]
            best = int(same.argmax())
            if same[best] > _SAME_ABOVE:
                self._names[life.key] = lost.pop(best)[0]

    def _forget_names(self) -> None:
        """Forget those that no frame can bring back."""
        if len(self._names) > _MOST_NAMES:
            there = {life.key for life in (*self._crowd.lives, *self._crowd.gone)}
            oldest = self._history.first.before.frame
            self._names = {
                key: name
                for key, name in self._names.items()
                if key in there or key.frame >= oldest
            }

    def _open(self, image: NDArray[np.generic], interval: float, boxes: Sequence[Box]) -> Frame:
        follows_light = self._follower.parameters.follow_light
        return self._camera.open(image, interval, boxes, self._follower.background, follows_light)

    def _keep(self, frame: Frame) -> None:
        self._camera.keep(frame)
        self._shape = (frame.image.shape, frame.image.dtype)

    def _misfit(self, image: NDArray[np.generic]) -> str:
        shape, kind = self._shape or ((), None)
        return (
            f"image is {image.shape} {image.dtype}, but the others were {shape} {kind}; make "
            "another tracker to change the image's size or kind"
        )


def _not_among(known: Sequence[Sighting], seen: Sequence[Sighting]) -> list[Sighting]:
    """Those of what was seen that were not said before of the same frame."""
    if not known:
        return list(seen)
    boxes = np.array([one.box for one in known])
    return [one for one in seen if overlaps(one.box[None], boxes).max() <= DOUBLED_ABOVE]
