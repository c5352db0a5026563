"""Tracks any number of targets through the frames of one camera.

1. The image front end prepares the frame: gain control, light, camera motion, background.
2. Late detections are put where they belong, and the frames since are processed again.
3. The targets are followed into the frame, with the detections of it.
4. Those that are sure enough are told, under ids that are never used again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, flatten
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections, Sighting, sightings, usable
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, Moment, thinned
from pf_tracker_ros.targets.keeper import CrowdKeeper
from pf_tracker_ros.targets.lifecycle import is_on
from pf_tracker_ros.targets.out_of_sequence import (
    StampedDetections,
    insert_late,
    merged,
    replay_track,
    reprocess,
)
from pf_tracker_ros.targets.relearning import (
    Sight,
    learned_again,
    needs_learning,
    reconfigured,
    resized,
)
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.targets.tracks import Crowd, Key, Life, Names
from pf_tracker_ros.tracking.image_front_end import ImageFrontEnd
from pf_tracker_ros.tracking.input_checks import check_box, check_seed
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter

NOMINAL_INTERVAL = 0.04
"""Seconds from one frame to the next where nobody tells."""

# A target's frame may have been lost on the way; one so much later stands in for it.
_SUBSTITUTE_WITHIN = NANOSECONDS
# Through so many frames a target is followed to catch up: in the meantime no image is answered.
_MOST_CAUGHT_UP = 30


class NotKeptError(ValueError):
    """The frame that a target was drawn on is not kept any more."""


class Started(NamedTuple):
    """A target that somebody asked for.

    Attributes:
        id: Its own, never that of another object.
        caught_up: Frames since the one that it was drawn on, which it was followed through.
    """

    id: int
    caught_up: int = 0


class TrackManager:
    """Follows the targets of one camera, none to `max_targets`, and knows their ids.

    Where only one target may be, a new one takes the place of the one before, and everything begins
    with it: gain control, light, background and the source of randomness. It so depends on nothing
    that came before.

    It can be copied and pickled, with its targets but without the frames for late detections.

    Attributes:
        left_out: Why detections of the last update were no use.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        self._parameters = parameters
        self._seed = check_seed(seed)
        with usual_arithmetic():
            self._target_filter = TargetFilter(parameters)
        self._keeper = CrowdKeeper(self._target_filter, parameters, self._seed)
        self._front_end = self._new_front_end()
        self._crowd = Crowd()
        self.frames = FrameBuffer()
        self._names = Names()
        self._sights: dict[Key, Sight] = {}
        self.left_out: tuple[str, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        # Images would only make a copy large.
        return self.__dict__ | {"frames": self.frames.emptied(), "_sights": {}}

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    @property
    def seed(self) -> int:
        """As given."""
        return self._seed

    @property
    def max_targets(self) -> int:
        """As the parameter says."""
        return self._parameters.max_targets

    @property
    def last_frame(self) -> Frame | None:
        """The one that was given last; None before the first, and in a fresh copy."""
        return self._front_end.frame

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

    def map_likelihood(self, id: int) -> LikelihoodMap | None:
        """How likely a target is around its box, in the frame that was given last.

        Nothing is tracked by it. None where there is no such target, or no frame as in a copy.
        """
        life, frame = self._names.told(self._crowd.lives).get(id), self._front_end.frame
        if life is None or frame is None:
            return None
        with usual_arithmetic():
            return self._target_filter.map_likelihood(life.target, frame)

    # Parameters

    def check_parameters(self, other: TrackManager) -> None:
        """Try what `take_parameters` would do, and change nothing.

        Raises:
            ParameterError: As `take_parameters`.
        """
        with usual_arithmetic():
            self._adapted(other)

    def take_parameters(self, other: TrackManager) -> None:
        """Go on with the parameters and the seed of another manager, keeping the targets.

        What decides on how a target is described, such as the motion model, learns every target
        again from where it was last seen; frames before the change are then gone for late
        detections.

        Args:
            other: Whose parameters to take, and nothing else; what both only read is shared.

        Raises:
            ParameterError: A target was never seen that would have to be learned again.
        """
        with usual_arithmetic():
            crowd, moments = self._adapted(other)
        self.frames.put(moments)
        if other._target_filter.needs_foreground != self._target_filter.needs_foreground:
            self._front_end.reset_background()
        self._crowd, self._seed = crowd, other._seed
        self._parameters, self._target_filter = other._parameters, other._target_filter
        self._keeper = other._keeper
        self._front_end.configure(several=self.max_targets > 1)

    def _adapted(self, other: TrackManager) -> tuple[Crowd, Sequence[Moment]]:
        """The targets, and the moments to be kept, for the parameters of another manager."""
        moments, target_filter = self.frames.moments, other._target_filter
        before = (one for moment in moments for one in moment.before.lives)
        lives = [*self._crowd.lives, *self._crowd.gone, *before]
        if not needs_learning(lives, self.parameters, other.parameters):
            return reconfigured(self._crowd, target_filter), [
                replace(
                    moment,
                    before=reconfigured(moment.before, target_filter),
                    begun=reconfigured(Crowd(lives=moment.begun), target_filter).lives,
                )
                for moment in moments
            ]
        is_same = other._parameters.appearance == self._parameters.appearance
        appearance = None if is_same else other._keeper.appearance
        crowd, unseen = learned_again(self._crowd, self._sights, target_filter, appearance)
        for life in unseen:
            if life.is_told and life.key in self._names:
                raise ParameterError(
                    f"the target {self._names[life.key]} would have to be learned again, and no "
                    "frame that is still kept shows it; stop it first, or wait until it is seen"
                )
        return crowd, []

    # Frames

    def accepts_image(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and kind of those before; any does before the first."""
        return self._is_waiting or self._front_end.accepts_image(image)

    def misfit(self, image: NDArray[np.generic]) -> str:
        """Why an image that does not fit is refused."""
        return (
            f"image is {image.shape} {image.dtype}, but the others were {self._front_end.image_format}; "
            "start again to change the image's size or kind"
        )

    def update(
        self,
        frame: Frame,
        interval: float | None = None,
        detections: Sequence[StampedDetections] = (),
    ) -> None:
        """Follow all targets into the next frame.

        Args:
            frame: Its image of the size and kind of those before; checked, and the manager's from
                now on.
            interval: Seconds since the last frame, from 0; None where nobody knows.
            detections: What detectors have said since then, of this frame or of earlier ones.

        Raises:
            ValueError: The image does not fit; the last good state is kept.
        """
        if not self.accepts_image(frame.image):
            raise ValueError(self.misfit(frame.image))
        interval = NOMINAL_INTERVAL if interval is None else interval
        self.left_out = ()
        if not detections and self._is_waiting:
            self._front_end = self._new_front_end(frame)
            self.frames.add(Moment(frame, interval, self._crowd))
            return
        if not self._front_end.accepts_image(frame.image):
            self.forget_camera()
        with usual_arithmetic():
            told = self._names.told(self._crowd.lives)
            self._open(self._front_end, frame, interval, self._crowd.boxes)
            of_now = [one for one in detections if _is_of_now(one.stamp, frame.stamp, interval)]
            late = [one for one in detections if one not in of_now]
            moments, left_out = insert_late(self.frames, late, frame.stamp, self._sightings)
            crowd, revised = reprocess(self._keeper, moments) if moments else (self._crowd, [])
            seen: tuple[Sighting, ...] | None = None
            for answer in of_now:
                found, reasons = self._sightings(answer.detections, frame)
                seen = merged(seen, found)
                left_out += reasons
            moment = Moment(frame, interval, crowd, seen)
            crowd = self._keeper.advance(crowd, frame, interval, seen)
        self._front_end.commit(frame)
        self.frames.revise(revised)
        self.frames.add(moment)
        self.left_out = tuple(dict.fromkeys(left_out))
        if revised:
            self._names.pass_on(told, crowd)
        self._crowd, self._sights = crowd, _sights_after(frame, crowd, self._sights)
        for life in crowd.lives:
            if life.is_told:
                self._names.name(life)
        oldest = self.frames.first.before if len(self.frames) else crowd
        self._names.forget(crowd, oldest.frame)

    @property
    def _is_waiting(self) -> bool:
        """Whether nothing depends on a frame: a single target, which is not there yet, is all."""
        return self.max_targets == 1 and not self._crowd.lives and not self._crowd.is_heard

    def _open(
        self, front_end: ImageFrontEnd, frame: Frame, interval: float, boxes: Sequence[Box]
    ) -> None:
        target_filter, follow_light = self._target_filter, self._parameters.follow_light
        front_end.prepare(frame, interval, boxes, target_filter.needs_foreground, follow_light)

    def _sightings(
        self, detections: Detections, frame: Frame
    ) -> tuple[tuple[Sighting, ...] | None, list[str]]:
        detector = self._parameters.detector
        wanted = detections.with_labels(detector.labels)
        seen, reasons = sightings(wanted, frame, detector.score_above, self._keeper.appearance)
        if seen or not len(wanted) or len(usable(wanted, frame.size, -np.inf)[0]):
            return tuple(seen), reasons
        # None of the boxes makes sense: that does not say that nothing is there.
        return None, reasons

    def _new_front_end(self, frame: Frame | None = None) -> ImageFrontEnd:
        several = self.max_targets > 1
        return ImageFrontEnd(self._seed, frame, removes_ghosts=several, estimates_motion=several)

    def resize(self, frame: Frame) -> bool:
        """Go on with images of another size, keeping the targets with their ids.

        They are learned again from where they were last seen, scaled; those that were never seen
        are forgotten, and so are the frames before.

        Args:
            frame: One of that size, to be given to `update` next.

        Returns:
            Whether it could be done: the image is of the same kind and aspect ratio, and no target
            in it is smaller than a pixel. If not, all is as before.
        """
        known = self._front_end.frame
        last = scaled_to(known.image, frame.image) if known else None
        if known is None or last is None:
            return False
        front_end, opened = self._new_front_end(), Frame(last, known.stamp)
        boxes = [scaled_box(box, known.size, opened.size) for box in self._crowd.boxes]
        if any(min(box[2:]) < 1.0 for box in boxes):
            return False
        with usual_arithmetic():
            self._open(front_end, opened, 0.0, boxes)
            crowd, sights = resized(self._crowd, self._sights, self._target_filter, known, opened)
        front_end.commit(opened)
        self._front_end, self._crowd, self._sights = front_end, crowd, sights
        self.frames.clear()
        return True

    def forget_past(self) -> None:
        """Let no detection be of the frames so far, as where time begins anew."""
        self.frames.clear()

    # Targets

    def check_room(self, count: int) -> None:
        """Refuse one more target where there are as many as there may be, or more.

        A single target makes room for the next one.

        Args:
            count: Targets that there are, or that are to begin before it.

        Raises:
            ValueError: There is no room for it.
        """
        most = self.max_targets
        if most == 1:
            return
        if count == most:
            raise ValueError(
                f"there are {counted(most, 'target')}, as many as there may be; stop one first, or "
                "allow more"
            )
        if count > most:
            raise ValueError(
                f"there are {count} targets, and there may be {most}; stop {count - most + 1} first"
            )

    def is_followed(self, box: Box) -> bool:
        """Whether a box, pixels, is on a target as the last frame left it."""
        told = self._names.told(self._crowd.lives).values()
        return any(_is_shown_in(life, box) for life in told)

    def start_on(self, frame: Frame, box: Box, label: str = "") -> Started:
        """Take a target on a frame with which all begins.

        Args:
            frame: The first one, or, for the only target that there may be, any one; checked, and
                the manager's from now on.
            box: (x, y, width, height) of the target, pixels; checked.
            label: What it is.
        """
        if self.max_targets == 1:
            with usual_arithmetic():
                return self._start_alone(frame, box, label, ())
        with usual_arithmetic():
            self._open(self._front_end, frame, 0.0, [box])
            self._front_end.commit(frame)
            self.frames.add(Moment(frame, 0.0, self._crowd))
            self._crowd = self._keeper.advance(self._crowd, frame, 0.0, None)
            return self._start_beside(frame, box, label, self.frames.moments)

    def start(self, box: Box, stamp: int = 0, label: str = "") -> Started:
        """Take a new target by hand; no detector ends it.

        A box on a target that there is, and that is not lost, takes that one over, with its id.

        Args:
            box: (x, y, width, height) of the target, pixels.
            stamp: Of the frame that it was drawn on, nanoseconds; 0 for the last one.
            label: What it is.

        Raises:
            ValueError: The box is not usable, or there are as many targets as there may be; all are
                kept.
            NotKeptError: The frame is not kept any more.
        """
        moments = self._moments_from(stamp)
        frame = moments[0].frame if moments else self._front_end.frame
        if frame is None:
            raise ValueError("there is no frame so far, as in a fresh copy; give one first")
        first_box = check_box(box, frame.size)
        with usual_arithmetic():
            if self.max_targets == 1:
                return self._start_alone(frame, first_box, label, moments)
            return self._start_beside(frame, first_box, label, moments)

    def _moments_from(self, stamp: int) -> list[Moment]:
        """The moments from the one on that a target was drawn on; none where no frame is kept.

        Where they are too many, those in between are thinned out evenly.

        Raises:
            ValueError: They are not kept any more, or are of another size.
        """
        last = self._front_end.frame
        if last is None or stamp in (0, last.stamp) or last.stamp == 0:
            return self.frames.moments[-1:]
        moments = self.frames.since(stamp)
        first = moments[0].stamp if moments else last.stamp
        behind = first - stamp
        # What was dropped before time went back says nothing of the frames since.
        is_dropped = stamp <= self.frames.dropped_until <= last.stamp
        if behind > _SUBSTITUTE_WITHIN or is_dropped:
            raise NotKeptError(
                f"it was drawn on a frame from {behind / NANOSECONDS:.3f} s before the oldest one "
                f"here; allowed: one of the last {counted(max(len(moments), 1), 'frame')}, back to "
                f"{(last.stamp - first) / NANOSECONDS:.3f} s ago (parameters 'history_frames' and "
                "'history_megabytes'), or stamp 0 for the next one"
            )
        return thinned(moments, _MOST_CAUGHT_UP)

    def _start_alone(
        self, frame: Frame, box: Box, label: str, moments: Sequence[Moment]
    ) -> Started:
        """Take the only target there may be; all begins anew with its frame."""
        front_end, keeper = self._new_front_end(), self._keeper
        self._open(front_end, frame, 0.0, [box])
        then = moments[1].before if len(moments) > 1 else self._crowd
        key = self._names.next_by_hand(then.frame)
        generator_state = np.random.default_rng(np.random.SeedSequence(self._seed))
        life = keeper.initiator.begin(frame, box, key, label, generator_state)
        crowd = replace(then, lives=(life,), gone=())
        sights = {key: Sight(frame, box)}
        earlier = [
            one.without_targets()
            for one in self.frames.moments
            if moments and one.stamp < moments[0].stamp
        ]
        revised = [Moment(frame, 0.0, replace(crowd, lives=()), begun=(life,))]
        for moment in moments[1:]:
            front_end.commit(frame)
            frame = moment.frame
            self._open(front_end, frame, moment.interval, crowd.boxes)
            revised.append(Moment(frame, moment.interval, crowd, moment.seen))
            crowd = keeper.advance(crowd, frame, moment.interval, moment.seen)
            sights = _sights_after(frame, crowd, sights)
        front_end.commit(frame)
        self._front_end, self._crowd, self._sights = front_end, crowd, sights
        self.frames.put([*earlier, *revised] if frame.stamp else ())
        return Started(self._names.name(life), len(revised) - 1)

    def _start_beside(
        self, frame: Frame, box: Box, label: str, moments: Sequence[Moment]
    ) -> Started:
        """Take one more target."""
        then = moments[1].before if len(moments) > 1 else self._crowd
        same = [one for one in then.lives if _is_shown_in(one, box)]
        if not any(one.key in self._names for one in same):
            self.check_room(len(self.targets))
        key = self._names.next_by_hand(then.frame)
        life = self._keeper.initiator.begin(frame, box, key, label)
        if same and not label:
            life = replace(life, votes=same[0].votes)
        revised: list[Moment] = []
        if moments:
            life, revised = replay_track(self._keeper, life, moments, same)
        keys = [one.key for one in same]
        others = [one for one in self._crowd.lives if one.key not in keys]
        # What a detector has started since, where the target is by now, is the target.
        keys += [one.key for one in others if not one.by_hand and _are_the_same(one, life)]
        others = [one for one in others if one.key not in keys]
        surplus = self._keeper.initiator.surplus([*others, life])
        others = [one for one in others if one.key not in surplus]
        self.frames.revise([one.without([*keys, *surplus]) for one in revised])
        self._crowd = replace(self._crowd, lives=(*others, life))
        sights = {**self._sights, key: Sight(frame, box)}
        self._sights = _sights_after(self._front_end.frame or frame, self._crowd, sights)
        self._names.hand_over(keys, life.key)
        return Started(self._names.name(life), max(len(moments) - 1, 0))

    def stop(self, id: int) -> None:
        """Forget a target; a detector that still sees it will start it again, with another id.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        life = self.check_known(id)
        self._crowd = self._crowd.without(life)
        if len(self.frames):
            last = self.frames.last
            self.frames.revise([replace(last, stopped=(*last.stopped, life))])

    def check_known(self, id: int) -> Life:
        """The target of an id, be it that it has ended and is remembered.

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
        return life

    def clear(self) -> None:
        """Forget all targets, those that have ended too; what the detector sees, it starts again.

        Their ids are not used again. The frames stay, for a target that was drawn on one of them.
        """
        self._crowd = replace(self._crowd, lives=(), gone=())
        self._sights = {}
        self.frames.put([one.without_targets() for one in self.frames.moments])

    def forget_camera(self) -> None:
        """Forget all targets, and take images of any size and kind."""
        self.clear()
        self.frames.clear()
        self._front_end = self._new_front_end()


def usual_arithmetic() -> np.errstate:
    """NumPy's own error handling, whatever the program around it has set.

    Likelihoods far from the target vanish, which `numpy.seterr(all="raise")` would make an error.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")


def _sights_after(frame: Frame, crowd: Crowd, before: Mapping[Key, Sight]) -> dict[Key, Sight]:
    """Where each target was last seen, after a frame."""
    sights: dict[Key, Sight] = {}
    for life in crowd.lives:
        estimate = life.target.estimate
        if estimate.state == "tracking":
            sights[life.key] = Sight(frame, estimate.box)
        elif life.key in before:
            sights[life.key] = before[life.key]
    return sights


def _is_of_now(stamp: int, now: int, interval: float) -> bool:
    """Whether a detection is of the frame at hand: up to half an interval before it."""
    return 0 in (stamp, now) or (now - stamp) / NANOSECONDS <= interval / 2


def _is_shown_in(life: Life, box: Box) -> bool:
    """Whether a box is on a target; where a lost one is, nobody knows."""
    return life.target.estimate.state != "lost" and is_on(life, np.array(box))


def _are_the_same(one: Life, other: Life) -> bool:
    return other.target.estimate.state != "lost" and _is_shown_in(one, other.target.estimate.box)
