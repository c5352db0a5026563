"""The tracker of several targets, started and corrected by hand or by a detector."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, build, change, flatten
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.detections import Detections, Sighting, sightings, usable
from pf_tracker_ros.targets.hindsight import fill_in, follow_alone, merged, work_out
from pf_tracker_ros.targets.history import History, Moment
from pf_tracker_ros.targets.initiator import is_on
from pf_tracker_ros.targets.keeper import CrowdKeeper
from pf_tracker_ros.targets.life import Life
from pf_tracker_ros.targets.names import Names
from pf_tracker_ros.targets.parameters import MultiTrackerParameters, multi_preset_parameters
from pf_tracker_ros.targets.relearning import (
    Memory,
    learned_again,
    needs_learning,
    reconfigured,
    resized,
)
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.camera import Camera
from pf_tracker_ros.tracking.follower import Follower
from pf_tracker_ros.tracking.input_checks import check_box, check_image, check_interval, check_seed
from pf_tracker_ros.tracking.scaling import scaled_to
from pf_tracker_ros.tracking.tracker import NOMINAL_INTERVAL, usual_arithmetic

_NO_FRAME = "there is no frame so far, as in a fresh copy; give one to update first"


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
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: MultiTrackerParameters, seed: int = 0) -> None:
        if not isinstance(parameters, MultiTrackerParameters):
            raise TypeError(
                f"parameters is {parameters!r}; for a preset, use MultiTracker.from_preset(name)"
            )
        self._parameters = parameters
        self._seed = check_seed(seed)
        with usual_arithmetic():
            self._follower = Follower(parameters, has_several=True)
        self._keeper = CrowdKeeper(self._follower, parameters, self._seed)
        self._camera = self._new_camera()
        self._crowd = Crowd()
        self._history = History()
        self._names = Names()
        self._shape: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self.left_out: tuple[str, ...] = ()

    def __copy__(self) -> MultiTracker:
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_history": self._history.emptied()}

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
            ValueError: The seed is no whole number from 0.
        """
        values = multi_preset_parameters(preset)
        values = change(MultiTrackerParameters, values, parameters or {})
        return cls(build(MultiTrackerParameters, values), seed)

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    @property
    def history(self) -> History:
        """The last frames, for late detections; may be limited otherwise."""
        return self._history

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Change parameters, all or none, keeping the targets with their ids.

        What decides on how a target is described, such as the motion model, learns every target
        again from where it was last seen; frames before the change are then gone for late
        detections.

        Args:
            values: Full parameter name to value.

        Raises:
            ParameterError: A name or value is not allowed, values contradict each other, or a
                target was not seen for so long that it could not be learned.
        """
        values = change(MultiTrackerParameters, self.parameters, values)
        self.share_parameters(MultiTracker(build(MultiTrackerParameters, values), self._seed))

    def share_parameters(self, other: MultiTracker) -> None:
        """Go on with the parameters and the seed of another tracker, sharing what both only read.

        Args:
            other: Whose parameters to take, and nothing else.

        Raises:
            ParameterError: As `set_parameters`.
        """
        with usual_arithmetic():
            crowd, moments = self._adapted(other)
        self._history.put(moments)
        if other._follower.needs_foreground != self._follower.needs_foreground:
            self._camera.forget_background()
        self._crowd, self._seed = crowd, other._seed
        self._parameters, self._follower = other._parameters, other._follower
        self._keeper = other._keeper

    def check_parameters(self, other: MultiTracker) -> None:
        """Try what `share_parameters` would do, and change nothing.

        Raises:
            ParameterError: As `set_parameters`.
        """
        with usual_arithmetic():
            self._adapted(other)

    def _adapted(self, other: MultiTracker) -> tuple[Crowd, tuple[Moment, ...]]:
        """The targets, and the moments to be kept, for the parameters of another tracker."""
        memory = Memory(self._crowd, self._history, self._camera.frame)
        if not needs_learning(memory, self.parameters, other.parameters):
            return reconfigured(memory, other._follower)
        crowd, unseen = learned_again(memory, other._follower)
        for life in unseen:
            if life.is_told and life.key in self._names:
                raise ParameterError(
                    f"the target {self._names[life.key]} would have to be learned again, and no "
                    "frame that is still kept shows it; stop it first, or wait until it is seen"
                )
        return crowd, ()

    def fits(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and kind of those before; any does before the first."""
        return self._shape is None or self._shape == (image.shape, image.dtype)

    def resize(self, image: NDArray[np.generic]) -> bool:
        """Go on with images of another size, keeping the targets with their ids.

        They are learned again from where they were last seen, scaled; those that were not seen for
        long are forgotten, and so are the frames before.

        Args:
            image: One of that size, to be given to `update` next.

        Returns:
            Whether it could be done: the image is of the same kind and aspect ratio. If not, all is
            as before.

        Raises:
            ValueError: It is no image.
        """
        check_image(image)
        frame = self._camera.frame
        last = scaled_to(frame.image, image) if frame else None
        if frame is None or last is None:
            return False
        with usual_arithmetic():
            memory = Memory(self._crowd, self._history, frame)
            crowd = resized(memory, self._follower, image)
            self._camera = self._new_camera()
            boxes = [life.target.estimate.box for life in crowd.lives]
            self._keep(self._open(last, 0.0, boxes))
        self._crowd = crowd
        self._history.clear()
        return True

    def forget_past(self) -> None:
        """Let no detection be of the frames so far, as where time begins anew."""
        self._history.clear()

    def clear(self) -> None:
        """Forget all targets, those that have ended too; what the detector sees, it starts again.

        Their ids are not used again.
        """
        self._crowd = replace(self._crowd, lives=(), gone=())
        self._history.clear()

    def forget_camera(self) -> None:
        """Forget all targets, and take images of any size and kind."""
        self.clear()
        self._camera, self._shape = self._new_camera(), None

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
            for life in self._names.told(self._crowd.lives).values()
        ]
        return tuple(sorted(told, key=lambda target: target.id))

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
        if self._shape and self._shape != (image.shape, image.dtype):
            raise ValueError(self._misfit(image))
        with usual_arithmetic():
            frame = self._camera.frame
            if self._shape is None:
                # A copy, since the history keeps it while the caller may write to it.
                frame = self._open(image.copy(), 0.0, [first_box])
                self._history.add(Moment(frame, 0.0, self._crowd))
                self._crowd = self._keeper.advance(self._crowd, frame, 0.0, None)
            elif frame is None:
                raise ValueError(_NO_FRAME)
            elif not np.array_equal(frame.image, image, equal_nan=image.dtype.kind == "f"):
                raise ValueError(
                    "image is not the one that was given last; give it to update first, then start "
                    "on it"
                )
            self._keep(frame)
            return self._begin(frame, first_box, label, ())

    def start_earlier(self, box: ArrayLike, age: float = 0.0, label: str = "") -> int:
        """Take a new target by hand that somebody saw in a frame gone by.

        Args:
            box: (x, y, width, height) of the target in pixels, as for `Tracker.start`.
            age: Seconds from that frame to the last one that was given to `update`.
            label: What it is.

        Returns:
            Its id, as of `start`.

        Raises:
            ValueError: The box, the age or the label is not usable, no frame is kept from then, or
                there are as many targets as there may be; all are kept.
        """
        back, frame = check_interval(age), self._camera.frame
        if not isinstance(label, str):
            raise ValueError(f"label is {label!r}; allowed: a text")
        if frame is None:
            raise ValueError(_NO_FRAME)
        first_box = check_box(box, frame.size)
        moments = self._history.since(back)
        if moments is None and (len(self._history) or back > NOMINAL_INTERVAL / 2):
            raise ValueError(
                f"it was drawn on a frame from {back:.3f} s ago; allowed: one of the last "
                f"{len(self._history)}, back to {self._history.seconds:.3f} s ago"
            )
        with usual_arithmetic():
            return self._begin(frame, first_box, label, moments or ())

    def is_followed(self, box: Box) -> bool:
        """Whether a box, pixels, is on a target as the last frame left it."""
        told = self._names.told(self._crowd.lives).values()
        return any(_is_shown_in(life, box) for life in told)

    def check_room(self, count: int) -> None:
        """Refuse one more target where there are as many as there may be, or more.

        Args:
            count: Targets that there are, or that are to begin before it.

        Raises:
            ValueError: There is no room for it.
        """
        most = self._parameters.targets.most
        if count == most:
            raise ValueError(
                f"there {'is' if most == 1 else 'are'} {counted(most, 'target')}, as many as there "
                "may be; stop one first, or allow more"
            )
        if count > most:
            raise ValueError(
                f"there are {count} targets, and there may be {most}; stop {count - most + 1} first"
            )

    def _begin(self, frame: Frame, box: Box, label: str, moments: Sequence[Moment]) -> int:
        """Take a new target.

        Args:
            frame: The last one.
            box: Of the target.
            label: What it is.
            moments: From the one that the box was drawn on, up to the last one; none for that.

        Raises:
            ValueError: There are as many targets as there may be, and the box is on none of them.
        """
        then = moments[1].before if len(moments) > 1 else self._crowd
        same = [one for one in then.lives if _is_shown_in(one, box)]
        if not any(one.key in self._names for one in same):
            self.check_room(len(self.targets))
        drawn_on = moments[0].frame if moments else frame
        key = self._names.next_by_hand(then.frame)
        life = self._keeper.initiator.begin(drawn_on, box, key, label)
        if same and not label:
            life = replace(life, votes=same[0].votes)
        keys = [one.key for one in same]
        moments = moments or self._history.moments[-1:]
        if moments:
            life, revised = follow_alone(self._keeper, life, moments, same)
            self._history.revise(revised)
        others = (one for one in self._crowd.lives if one.key not in keys)
        self._crowd = replace(self._crowd, lives=(*others, life))
        self._names.hand_over(keys, life.key)
        return self._names.name(life)

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
        is_number = isinstance(id, int | np.integer) and not isinstance(id, bool)
        life = lives.get(id) if is_number else None
        if life is None:
            known = ", ".join(str(target.id) for target in self.targets) or "none"
            raise ValueError(f"no target has the id {id!r}; there are: {known}")
        self._crowd = self._crowd.without(life)
        if len(self._history):
            last = self._history.last
            self._history.revise([replace(last, stopped=(*last.stopped, life))])

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
                names, or several such answers; None where it has said nothing. `left_out` tells
                what was no use in it.

        Returns:
            The targets that are sure enough, in the order of their ids.

        Raises:
            ValueError: The image, `dt` or what is given for detections is not usable; the last
                good state is kept.
        """
        check_image(image)
        if not self.fits(image):
            raise ValueError(self._misfit(image))
        answers = _answers(detections)
        interval = NOMINAL_INTERVAL if dt is None else check_interval(dt)
        with usual_arithmetic():
            told = self._names.told(self._crowd.lives)
            frame = self._open(
                image.copy(), interval, [life.target.estimate.box for life in self._crowd.lives]
            )
            of_now = [one for one in answers if one.age <= interval / 2]
            late = [one for one in answers if one not in of_now]
            moments, left_out = fill_in(self._history, late, interval, self._sightings)
            crowd, revised = work_out(self._keeper, moments) if moments else (self._crowd, [])
            seen: tuple[Sighting, ...] | None = None
            for answer in of_now:
                found, reasons = self._sightings(answer, frame)
                seen = merged(seen, found)
                left_out += reasons
            moment = Moment(frame, interval, crowd, seen)
            crowd = self._keeper.advance(crowd, frame, interval, seen)
        self._keep(frame)
        self._history.revise(revised)
        self._history.add(moment)
        self._crowd, self.left_out = crowd, tuple(dict.fromkeys(left_out))
        if revised:
            self._names.pass_on(told, crowd)
        for life in crowd.lives:
            if life.is_told:
                self._names.name(life)
        self._names.forget(crowd, self._history.first.before.frame)
        return self.targets

    def _sightings(
        self, detections: Detections, frame: Frame
    ) -> tuple[tuple[Sighting, ...] | None, list[str]]:
        detector = self._parameters.detector
        wanted = detections.with_labels(detector.labels)
        seen, reasons = sightings(wanted, frame, detector.score_above)
        if seen or not len(wanted) or len(usable(wanted, frame.size, -math.inf)[0]):
            return tuple(seen), reasons
        # None of the boxes makes sense: that does not say that nothing is there.
        return None, reasons

    def _new_camera(self) -> Camera:
        return Camera(self._seed, lays_ghosts=True, tells_motion=True)

    def _open(self, image: NDArray[np.generic], interval: float, boxes: Sequence[Box]) -> Frame:
        follower = self._follower
        return self._camera.open(
            image, interval, boxes, follower.needs_foreground, follower.parameters.follow_light
        )

    def _keep(self, frame: Frame) -> None:
        self._camera.keep(frame)
        self._shape = (frame.image.shape, frame.image.dtype)

    def _misfit(self, image: NDArray[np.generic]) -> str:
        shape, kind = self._shape or ((), None)
        return (
            f"image is {image.shape} {image.dtype}, but the others were {shape} {kind}; make "
            "another tracker to change the image's size or kind"
        )


def _is_shown_in(life: Life, box: Box) -> bool:
    """Whether a box is on a target; where a lost one is, nobody knows."""
    return life.target.estimate.state != "lost" and is_on(life, np.array(box))


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
