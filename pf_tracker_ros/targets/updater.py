"""Follows every target into the next frame, each with what the others leave to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import (
    Box,
    BoxesByAxis,
    are_at,
    as_box,
    covered,
    is_cut,
    overlaps,
    sides_apart,
)
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_SPREAD
from pf_tracker_ros.targets.course import Course
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.ground import Ground, grounds_of
from pf_tracker_ros.targets.tracks import Life
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import ExternalLikelihood, FramePrediction
from pf_tracker_ros.tracking.target_filter import TargetFilter

# Probability that a detection is not of its target, so that it says nothing of the place.
_WRONG = 0.02
# A target of which more than this is behind another one is not looked for.
_HIDDEN_ABOVE = 0.5
# Two boxes that overlap by more than this are on one object, and it is that of the one in front.
_SAME_ABOVE = 0.5
# How far a target may be from where it was expected, in its own sides.
_NEAR = 1.5
# What others in front explain of a box, beyond what was expected, counts against it so strongly.
_EXPLAINED = 30.0
_EXPLAINED_FREELY = 0.2
# Share of the way to a detection that its target goes; all of it where they overlap by less, unless
# the image is so sure of where it is.
_GAIN = 0.5
_FAR_BELOW = 0.5
_SURE_ABOVE = 0.6
# Standard deviation of a place that the image tells, in the sides of the box.
_IMAGE_SPREAD = np.array([0.3, 0.2])
# Confirmations over which sizes are averaged.
_SIZES = 3.3
# Seconds without a detection after which a hidden target is not told where its box is as good as
# that of the one in front.
_DOUBLED_AFTER = 0.2
# Degrees of freedom of how far the image may show a target from its course.
_TAIL = 3.0
# Confidence of a target on its own from which on its place counts fully for its course, and the
# least that it counts.
_FULLY_ABOVE, _LEAST_COUNT = 0.5, 0.05
# Every how many frames the size of a target on its own is looked for: it changes slowly.
_SIZE_EVERY = 2
# Seconds from one learning of a confirmed target to the next.
_LEARN_EVERY = 0.4
# Seconds without a detector's answer after which the image tells the sizes again.
_SILENT_AFTER = 2.0
# A target that overlaps what looks like it by more than this may be that. It is itself again within
# so many squared standard deviations of its course.
_ON_RIVAL, _DOUBT_GATE = 0.3, 6.0
# Seconds without a detector's answer after which there is none.
_ON_THEIR_OWN_AFTER = 10.0
# What a detection adds to the belief in its target, and the most that this can be.
_HIT, _LEAST_BELIEF, _MOST_BELIEF = 2.0, -1.0, 1.5
# What the detector misses now it will miss again in a moment: seconds until it decides anew.
_DECIDES_ANEW = 0.3
# Seconds without a frame after which a detection alone tells where its target is: particles are too
# few for all the places where it may be.
_PAUSED_AFTER = 1.0
# Of a hidden target it says at least so much that it was not found.
_LEAST_VISIBLE = 0.4


class Updater:
    """Follows and corrects targets, the one in front first.

    Targets explain their own pixels: what is in the box of one that is in front counts against
    those behind it, and one that is hidden is carried on by its motion alone. What was
    started by hand and is lost comes last and hides nothing, since nobody knows where it is. A
    detection is one more factor of the likelihood; it then brings the box along, and is learned
    from. Without any, or any more, the image has to tell the size, too, and the ground that all
    stand on. A single target without a rival near and without a detector is followed by its pixels
    alone, and looked for all over the image once it is lost.

    Args:
        target_filter: Follows each target.
        recall: Share of the visible targets that the detector finds.
        appearance: Describes the targets.
    """

    def __init__(self, target_filter: TargetFilter, recall: float, appearance: Appearance) -> None:
        self._target_filter = target_filter
        self._appearance = appearance
        self._log_miss = math.log(1.0 - recall)

    def update(
        self,
        lives: Sequence[Life],
        frame: Frame,
        interval: float,
        own: Sequence[Sighting | None],
        idle_for: float,
    ) -> tuple[Life, ...]:
        """The targets one frame later.

        Args:
            lives: N targets after the last frame, their courses in the next one.
            frame: The next one.
            interval: Seconds since the last one.
            own: The detection of each, None where there is none.
            idle_for: Seconds since the detector saw a frame.
        """
        updated = list(lives)
        grounds = grounds_of(lives)
        predicted = np.array([life.expected for life in lives]).reshape(-1, 4)
        front: list[Life] = []
        # What was just confirmed explains its pixels first, and a guess last; of the others, what
        # stands lower in the image, since it is nearer to the camera.
        lower = predicted[:, 1] + predicted[:, 3]
        unseen = np.array([one is None for one in own], dtype=np.bool_)
        guessed = unseen & np.array([_is_guess(life) for life in lives], dtype=np.bool_)
        is_silent = idle_for > _SILENT_AFTER
        alone = _are_alone(lives, predicted) & (idle_for > _ON_THEIR_OWN_AFTER)
        expected = self._expect(lives, frame, interval, own, alone, is_silent=is_silent)
        for place in np.lexsort((-lower, guessed, unseen)).tolist():
            life = lives[place]
            if life.is_rival and own[place] is None:
                target = self._target_filter.operations.move_to(
                    life.target, as_box(predicted[place])
                )
                life = replace(life, target=target)
            else:
                life = self._follow(
                    life,
                    predicted[place],
                    frame,
                    interval,
                    own=own[place],
                    expected=expected.get(place),
                    front=front,
                    ground=grounds.get(life.label),
                    is_alone=bool(alone[place]),
                    is_silent=is_silent,
                )
                if own[place] is None and life.is_on_its_own:
                    rivals = [one.host == life.key for one in lives]
                    life = self._doubt(life, lives[place], predicted[rivals])
            updated[place] = life
            if not _is_guess(life):
                front.append(life)
        return tuple(updated)

    def _expect(
        self,
        lives: Sequence[Life],
        frame: Frame,
        interval: float,
        own: Sequence[Sighting | None],
        alone: NDArray[np.bool_],
        *,
        is_silent: bool,
    ) -> dict[int, FramePrediction]:
        """Place of each target that will be followed to where it is expected.

        Those that others hid in the last frame are left out: most of them will be hidden again.
        """
        will_begin_anew = interval > _PAUSED_AFTER
        places, targets = [], []
        for place, (life, one) in enumerate(zip(lives, own, strict=True)):
            if will_begin_anew if one else life.is_rival or life.is_hidden:
                continue
            places.append(place)
            asks_for_size = bool(alone[place]) or _asks_for_size(life, one, is_silent)
            targets.append((life.target, asks_for_size))
        return dict(zip(places, self._target_filter.predict(targets, frame, interval), strict=True))

    def count_misses(
        self, lives: Sequence[Life], own: Sequence[Sighting | None], rhythm: float
    ) -> tuple[Life, ...]:
        """The targets, those that the detector did not find believed in less.

        Args:
            lives: In the frame that it saw.
            own: The detection of each, None where there is none.
            rhythm: Seconds since the frame that it saw before.
        """
        boxes = np.array([life.box for life in lives]).reshape(-1, 4)
        lower = boxes[:, 1] + boxes[:, 3]
        hiding = covered(boxes, boxes) * (lower[None] > lower[:, None])
        visible = 1.0 - hiding.max(axis=1, initial=0.0)
        decided = 1.0 - math.exp(-rhythm / _DECIDES_ANEW)
        loss = self._log_miss * decided * np.maximum(visible, _LEAST_VISIBLE)
        return tuple(
            life if one else replace(life, belief=life.belief + float(lost))
            for life, one, lost in zip(lives, own, loss, strict=True)
        )

    def _follow(
        self,
        life: Life,
        predicted: NDArray[np.float64],
        frame: Frame,
        interval: float,
        *,
        own: Sighting | None,
        expected: FramePrediction | None,
        front: Sequence[Life],
        ground: Ground | None,
        is_alone: bool,
        is_silent: bool,
    ) -> Life:
        """One target, behind others."""
        if own and interval > _PAUSED_AFTER:
            return self._begin_anew(life, frame, interval, own)
        target, is_hidden = life.target, False
        is_sized = _is_sized(life, own, is_silent)
        evidence: list[ExternalLikelihood] = []
        if own:
            evidence.append(_of_detection(own.box))
        elif not is_alone:
            evidence.append(_of_course(life))
        if is_sized and not is_alone and ground and life.stood is not None:
            evidence.append(partial(ground.log_likelihood, life.stood))
        # What is taken for a rival may be none: only what it looks like yields to it.
        front = [one for one in front if one.host in (None, life.key)]
        boxes = np.array([one.box for one in front]).reshape(-1, 4)
        are_near = _are_near(boxes, predicted)
        front, boxes = list(compress(front, are_near)), boxes[are_near]
        if len(boxes):
            hidden = covered(predicted[None], boxes)[0]
            evidence.append(_of_others(boxes, hidden))
            # What is only like a target hides it where its course is sure; else it is looked for.
            is_sure = life.target.estimate.confidence > _FULLY_ABOVE
            hides = np.array([is_sure or not one.is_rival for one in front])
            is_hidden = own is None and bool((hidden * hides).max() > _HIDDEN_ABOVE)
        if not is_hidden:
            if expected is None:
                asked = (target, is_alone or _asks_for_size(life, own, is_silent))
                (expected,) = self._target_filter.predict([asked], frame, interval)
            followed = self._target_filter.step(
                expected, _all_of(evidence), searches_everywhere=is_alone
            )
            if own is None and len(boxes):
                found = np.array(followed.estimate.box)
                is_hidden = _is_on_one(found, boxes)
                is_on_rival = _is_on_one(found, boxes[[one.is_rival for one in front]])
                known = followed.known_distractor if is_on_rival else target.known_distractor
                target = replace(target, known_distractor=known)
        course, log_size = life.course, life.log_size
        if is_hidden:
            target = self._target_filter.operations.coast(target, frame, interval)
            target = self._target_filter.operations.move_to(target, _inside(predicted, frame.size))
        else:
            target = followed
            if own is None:
                course, log_size = _corrected_by_image(life, target)
        is_doubled = is_hidden and life.unconfirmed_for > _DOUBLED_AFTER
        if is_doubled:
            are_told = [not one.is_rival for one in front]
            is_doubled = _is_on_one(np.array(target.estimate.box), boxes[are_told])
        life = replace(
            life,
            target=target,
            course=course,
            log_size=log_size,
            age=life.age + interval,
            unconfirmed_for=life.unconfirmed_for + interval,
            learned_for=life.learned_for + interval,
            is_hidden=is_hidden,
            is_doubled=is_doubled,
        )
        return self._correct(life, frame, own) if own else life

    def _doubt(self, life: Life, before: Life, rivals: NDArray[np.float64]) -> Life:
        """A target that may be another one by now, without its course moved, and not told as seen.

        It is doubted from when it jumps to what was seen beside it, and the filter does not know
        that as something else, or from when it is on what looks like it. That ends where its course
        leads, and once it is lost: where it is found again is where it is.

        Args:
            life: In this frame.
            before: After the last one, its course in this frame.
            rivals: (K, 4) boxes of what looks like it.
        """
        target, box, last = life.target, life.box, before.target
        if last.status.state == "lost":
            return replace(life, is_doubted=False)
        is_on_rival = overlaps(box[None], rivals).max(initial=0.0) > _ON_RIVAL
        is_doubted = bool(is_on_rival) or (
            target.known_distractor is None and _has_jumped(last, box)
        )
        if not is_doubted and before.is_doubted:
            variance = before.course.spread + np.square(_IMAGE_SPREAD * box[2:])
            apart = box[:2] + box[2:] / 2 - before.course.center
            is_doubted = bool((np.square(apart) / variance).sum() > _DOUBT_GATE)
        if not is_doubted:
            return replace(life, is_doubted=False)
        if target.estimate.state == "tracking":
            target = replace(target, estimate=replace(target.estimate, state="occluded"))
        return replace(life, target=target, course=before.course, is_doubted=True)

    def _begin_anew(self, life: Life, frame: Frame, interval: float, own: Sighting) -> Life:
        """A target that a detection shows after a pause, where its motion tells of no place."""
        target = self._target_filter.initialize(frame, as_box(own.box), life.target.generator_state)
        life = replace(
            life,
            target=target,
            age=life.age + interval,
            learned_for=life.learned_for + interval,
            is_hidden=False,
            is_doubled=False,
        )
        return self._correct(life, frame, own)

    def _correct(self, life: Life, frame: Frame, own: Sighting) -> Life:
        """A target that a detection confirms, with its box brought towards that."""
        box = life.box
        is_far = bool(overlaps(box[None], own.box[None])[0, 0] < _FAR_BELOW)
        # Where the image is sure, it takes a second detection to say that it is wrong.
        is_doubted = is_far and life.target.estimate.confidence > _SURE_ABOVE
        goes_over = is_far and not is_doubted
        share = 1.0 / min(life.confirmations + 1, _SIZES)
        log_size = life.log_size + share * (np.log(own.box[2:]) - life.log_size)
        size = np.exp(log_size)
        center, seen = box[:2] + box[2:] / 2, own.box[:2] + own.box[2:] / 2
        center = center + (1.0 if goes_over else _GAIN) * (seen - center)
        target = self._target_filter.operations.move_to(
            life.target, as_box([*(center - size / 2), *size])
        )
        learns = goes_over or (life.learned_for >= _LEARN_EVERY and not is_doubted)
        if learns:
            target = self._target_filter.operations.relearn(target, frame)
        life = life.viewed(own.descriptor, self._appearance) if own.is_clear else life
        return replace(
            life.voted(own.label, own.score),
            target=target,
            course=life.course.correct(seen, CENTER_SPREAD * size),
            log_size=log_size,
            belief=min(max(life.belief, _LEAST_BELIEF) + _HIT, _MOST_BELIEF),
            confirmations=life.confirmations + 1,
            unconfirmed_for=0.0,
            learned_for=0.0 if learns else life.learned_for,
            stood=life.stood if is_cut(own.box, frame.size) else np.array(target.estimate.box),
        )


def _corrected_by_image(life: Life, target: FilterState) -> tuple[Course, NDArray[np.float64]]:
    """The course and the (2,) log size of a target, corrected by where the image shows it."""
    log_size, box = life.log_size, np.array(target.estimate.box)
    deviation = _IMAGE_SPREAD * box[2:]
    if life.is_on_its_own:
        count = min(target.estimate.confidence / _FULLY_ABOVE, 1.0)
        deviation = deviation / max(count, _LEAST_COUNT)
        if target.status.state == "tracking":
            log_size = np.log(box[2:])
    return life.course.correct(box[:2] + box[2:] / 2, deviation), log_size


def _is_guess(life: Life) -> bool:
    """Whether nobody knows where a target is; those of a detector end once it does not see them."""
    return life.by_hand and life.target.estimate.state == "lost"


def _is_sized(life: Life, own: Sighting | None, is_silent: bool) -> bool:
    """Whether the image has to tell a target's size."""
    return own is None and (life.is_on_its_own or is_silent)


def _asks_for_size(life: Life, own: Sighting | None, is_silent: bool) -> bool:
    """Whether it has to in this frame."""
    is_due = life.target.followed_frames % _SIZE_EVERY == 0
    return is_due and _is_sized(life, own, is_silent)


def _has_jumped(last: FilterState, box: NDArray[np.float64]) -> bool:
    """Whether a target has jumped to a (4,) box, where something was seen beside it before."""
    return (
        last.second_peak is not None
        and bool(are_at(box, last.second_peak))
        and bool(sides_apart(box, last.estimate.box) >= 1.0)
    )


def _inside(box: NDArray[np.float64], image_size: tuple[int, int]) -> Box:
    """A (4,) box moved until its center is in the image, as those of the particles are."""
    half = box[2:] / 2
    center = np.clip(box[:2] + half, 0.0, image_size)
    return as_box([*(center - half), *box[2:]])


def _are_alone(lives: Sequence[Life], predicted: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which target is the only one, with no rival near its (4,) of the (N, 4) predictions."""
    is_only = sum(not life.is_rival for life in lives) == 1
    return np.array([is_only and _are_near(predicted, box).sum() == 1 for box in predicted], bool)


def _are_near(boxes: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(K,) which of (K, 4) boxes a target could overlap that is about at a (4,) place."""
    apart = np.abs(boxes[:, :2] + boxes[:, 2:] / 2 - place[:2] - place[2:] / 2)
    near: NDArray[np.bool_] = np.all(apart < boxes[:, 2:] / 2 + _NEAR * place[2:], axis=1)
    return near


def _is_on_one(box: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Whether a (4,) box is on the object of one of (K, 4) others."""
    return bool(overlaps(box[None], others).max(initial=0.0) > _SAME_ABOVE)


def _of_detection(box: NDArray[np.float64]) -> ExternalLikelihood:
    """The factor of a detection: near it a box is likelier, up to that it may be wrong."""
    center, spread = box[:2] + box[2:] / 2, CENTER_SPREAD * box[2:]

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        across = np.square((x + width / 2 - center[0]) / spread[0])
        down = np.square((y + height / 2 - center[1]) / spread[1])
        return np.log(_WRONG + (1.0 - _WRONG) * np.exp(-0.5 * (across + down)))

    return log_likelihood


def _of_course(life: Life) -> ExternalLikelihood:
    """The factor of how a target has moved: it seldom jumps aside."""
    center, size = life.course.center, life.box[2:]
    variance = life.course.spread + np.square(_IMAGE_SPREAD * size)

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        across = np.square(x + width / 2 - center[0]) / variance[0]
        down = np.square(y + height / 2 - center[1]) / variance[1]
        return -(_TAIL + 2.0) / 2.0 * np.log1p((across + down) / _TAIL)

    return log_likelihood


def _of_others(front: NDArray[np.float64], expected: NDArray[np.float64]) -> ExternalLikelihood:
    """The factor of (K, 4) boxes in front: what is in them is explained by others.

    Args:
        front: Boxes, at least one.
        expected: (K,) share of the target that each was expected to cover.
    """
    free = np.maximum(expected, _EXPLAINED_FREELY)

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        area = np.maximum(width * height, 1e-9)
        explained = (
            np.maximum(
                _shared(x, width, left, across) * _shared(y, height, top, down) / area - freely, 0.0
            )
            for (left, top, across, down), freely in zip(front, free, strict=True)
        )
        return -_EXPLAINED * reduce(np.add, explained)

    return log_likelihood


def _shared(
    start: NDArray[np.float64], side: NDArray[np.float64], other_start: float, other_side: float
) -> NDArray[np.float64]:
    """How much of sides along one axis is on another one, pixels."""
    end = np.minimum(start + side, other_start + other_side)
    return np.maximum(end - np.maximum(start, other_start), 0.0)


def _all_of(evidence: Sequence[ExternalLikelihood]) -> ExternalLikelihood | None:
    if not evidence:
        return None

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        return reduce(np.add, (one(boxes) for one in evidence))

    return log_likelihood
