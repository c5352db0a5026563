"""When a target begins, by hand or by detections, and when it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import Box, as_box, is_cut, overlaps
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_SPREAD
from pf_tracker_ros.targets.course import Course
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.tracks import Crowd, Key, Life
from pf_tracker_ros.tracking.target_filter import TargetFilter

# A detection that overlaps a target without one by more than this is taken for a bad one of it.
_TAKEN_ABOVE = 0.45
# Belief in a target of a detection with a score of 1; with less, it is as much below that.
_FIRST_BELIEF = 1.0
# That in a rival: it ends once a slow detector sees the frame and does not find it.
_RIVAL_BELIEF = -0.45
# Seconds; what a detector says in as many of its answers as come within them is confirmed.
_CONFIRMED_WITHIN = 0.3
# Which child of the seed the targets' randomness comes from; others are the camera's.
_RANDOMNESS_KEY = 1


class Initiator:
    """Starts targets: by hand, or on detections of none that there is.

    Args:
        target_filter: Follows each target.
        seed: Seeds all randomness.
        most: Targets at a time.
        appearance: Describes them.
    """

    def __init__(
        self, target_filter: TargetFilter, seed: int, most: int, appearance: Appearance
    ) -> None:
        self._target_filter = target_filter
        self._seed = seed
        self._most = most
        self._appearance = appearance

    def begin(
        self,
        frame: Frame,
        box: Box,
        key: Key,
        label: str,
        generator: np.random.Generator | None = None,
    ) -> Life:
        """A target that somebody asked for.

        Args:
            frame: That it was drawn on.
            box: Of the target, pixels.
            key: Names it.
            label: What it is.
            generator: Its source of randomness; None for one of its own among others.
        """
        life = self._life(frame, np.array(box), key, generator=generator)
        return life.voted(label, 1.0)

    def begin_rival(self, frame: Frame, box: NDArray[np.float64], key: Key, host: Life) -> Life:
        """What looks like a target beside it, in a (4,) box: no detector has found it so far."""
        life = self._life(frame, box, key).voted(host.label, 0.0)
        return replace(life, belief=_RIVAL_BELIEF, confirmations=0, host=host.key, stood=None)

    def start(self, crowd: Crowd, frame: Frame, rest: Sequence[tuple[int, Sighting]]) -> Crowd:
        """The crowd with new targets.

        Args:
            crowd: In this frame.
            frame: At hand.
            rest: The detections that are of none of the targets, with their places among all.
        """
        lives = list(crowd.lives)
        unconfirmed = [
            life.box for life in lives if life.unconfirmed_for > 0.0 and not life.is_rival
        ]
        boxes = np.array(unconfirmed).reshape(-1, 4)
        for place, one in rest:
            if sum(not life.is_rival for life in lives) >= self._most:
                break
            if overlaps(one.box[None], boxes).max(initial=0.0) > _TAKEN_ABOVE:
                continue
            key = Key(crowd.frame, place)
            life = self._life(frame, one.box, key, one.descriptor).voted(one.label, one.score)
            life = replace(life, belief=_FIRST_BELIEF + 2.0 * (one.score - 1.0))
            lives = [other for other in lives if not (other.is_rival and is_on(other, life.box))]
            lives.append(life)
        return replace(crowd, lives=tuple(lives))

    def join(self, crowd: Crowd, drawn: Sequence[Life]) -> Crowd:
        """The crowd with targets that somebody drew on its frame.

        They take over those that a detector has started there, and have room before them.

        Args:
            crowd: In that frame.
            drawn: As they begin in it.
        """
        if not drawn:
            return crowd
        lives = [
            life
            for life in crowd.lives
            if life.by_hand or not any(is_on(life, one.box) for one in drawn)
        ]
        lives += drawn
        surplus = self.surplus(lives)
        return replace(crowd, lives=tuple(life for life in lives if life.key not in surplus))

    def surplus(self, lives: Sequence[Life]) -> set[Key]:
        """Those that detectors have started beyond the number that there may be, the unsurest."""
        followed = [life for life in lives if not life.is_rival]
        started = [life for life in followed if not life.by_hand]
        started.sort(key=lambda life: (life.is_told, life.belief))
        return {life.key for life in started[: max(len(followed) - self._most, 0)]}

    def adopt(self, crowd: Crowd, own: Sequence[Sighting | None]) -> Crowd:
        """The crowd in which the rivals that detections show are targets, while there is room.

        Args:
            crowd: In this frame.
            own: The detection of each, None where there is none.
        """
        lives = []
        room = self._most - sum(not life.is_rival for life in crowd.lives)
        for life, one in zip(crowd.lives, own, strict=True):
            is_adopted = one is not None and life.is_rival and room > 0
            room -= is_adopted
            lives.append(replace(life, host=None) if is_adopted else life)
        return replace(crowd, lives=tuple(lives))

    def confirm(self, crowd: Crowd, image_size: tuple[int, int]) -> Crowd:
        """The crowd with those targets confirmed that were so often enough, while there is room.

        A fast detector has to say it in as many answers as a moment holds; a slow one is believed
        at once, since the next word would come too late. What the border cuts has to be said once
        more: half an object looks like others, and detectors are wrong there more often.

        Args:
            crowd: In this frame.
            image_size: (width, height), pixels.
        """
        answers = math.ceil(_CONFIRMED_WITHIN / max(crowd.rhythm, 1e-3) - 1e-6)
        needed = max(answers, 1)
        lives = []
        # Those that began before fewer targets were allowed may be too many.
        room = self._most - sum(life.by_hand or life.is_confirmed for life in crowd.lives)
        for life in crowd.lives:
            is_sure = life.confirmations >= needed + is_cut(life.box, image_size)
            if is_sure and not (life.is_confirmed or life.by_hand):
                is_sure = room > 0
                room -= is_sure
            lives.append(replace(life, is_confirmed=life.is_confirmed or is_sure))
        return replace(crowd, lives=tuple(lives))

    def _life(
        self,
        frame: Frame,
        box: NDArray[np.float64],
        key: Key,
        descriptor: Descriptor | None = None,
        generator: np.random.Generator | None = None,
    ) -> Life:
        if descriptor is None:
            (descriptor,) = self._appearance.extract(frame, box[None])
        if generator is None:
            place = 2 * key.place if key.place >= 0 else -2 * key.place - 1
            spawn_key = (_RANDOMNESS_KEY, key.frame, place)
            generator = np.random.default_rng(
                np.random.SeedSequence(self._seed, spawn_key=spawn_key)
            )
        target = self._target_filter.initialize(frame, as_box(box), GeneratorState.of(generator))
        course = Course.begin(box, CENTER_SPREAD * box[2:])
        stood = None if is_cut(box, frame.size) else box
        return Life(key, target, descriptor, course, np.log(box[2:]), _FIRST_BELIEF, stood=stood)


def is_on(life: Life, box: NDArray[np.float64]) -> bool:
    """Whether a target and a (4,) box are on the same object."""
    return bool(overlaps(life.box[None], box[None])[0, 0] > _TAKEN_ABOVE)


# Belief below which there is no such target.
_ENDS_BELOW = -1.0
# A target whose center is so near to the image's border, in its own sides, has left.
_LEFT_WITHIN = 0.03


class Deleter:
    """Ends targets that the detector does not find any more, or that have left the image.

    Args:
        remember: Seconds for which one that was told is remembered.
    """

    def __init__(self, remember: float) -> None:
        self._remember = remember

    def end(self, crowd: Crowd, image_size: tuple[int, int], interval: float) -> Crowd:
        """The crowd without those that end in this frame.

        Args:
            crowd: In this frame.
            image_size: (width, height), pixels.
            interval: Seconds since the last frame.
        """
        gone = [replace(life, gone_for=(life.gone_for or 0.0) + interval) for life in crowd.gone]
        lives = []
        for life in crowd.lives:
            if life.by_hand or not (life.belief < _ENDS_BELOW or _has_left(life, image_size)):
                lives.append(life)
            elif life.is_confirmed:
                gone.append(replace(life, gone_for=0.0))
        kept = [life for life in gone if (life.gone_for or 0.0) < self._remember]
        return replace(crowd, lives=tuple(lives), gone=tuple(kept))


def _has_left(life: Life, image_size: tuple[int, int]) -> bool:
    box = life.box
    center, margin = box[:2] + box[2:] / 2, _LEFT_WITHIN * box[2:]
    return bool((center <= margin).any() or (center >= np.array(image_size) - margin).any())
