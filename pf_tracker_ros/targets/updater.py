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
    are_same_place,
    as_box,
    is_truncated,
    pairwise_coverage,
    pairwise_iou,
    relative_center_distances,
)
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_STD
from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.ground import Ground, fit_grounds
from pf_tracker_ros.targets.tracks import Track
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
        tracks: Sequence[Track],
        frame: Frame,
        interval: float,
        own: Sequence[Detection | None],
        time_since_detection: float,
    ) -> tuple[Track, ...]:
        """The targets one frame later.

        Args:
            tracks: N targets after the last frame, their courses in the next one.
            frame: The next one.
            interval: Seconds since the last one.
            own: The detection of each, None where there is none.
            time_since_detection: Seconds since the detector saw a frame.
        """
        updated = list(tracks)
        grounds = fit_grounds(tracks)
        predicted = np.array([track.expected for track in tracks]).reshape(-1, 4)
        front: list[Track] = []
        # What was just confirmed explains its pixels first, and a guess last; of the others, what
        # stands lower in the image, since it is nearer to the camera.
        lower = predicted[:, 1] + predicted[:, 3]
        unseen = np.array([one is None for one in own], dtype=np.bool_)
        guessed = unseen & np.array([_is_guess(track) for track in tracks], dtype=np.bool_)
        is_silent = time_since_detection > _SILENT_AFTER
        alone = _are_alone(tracks, predicted) & (time_since_detection > _ON_THEIR_OWN_AFTER)
        expected = self._expect(tracks, frame, interval, own, alone, is_silent=is_silent)
        for place in np.lexsort((-lower, guessed, unseen)).tolist():
            track = tracks[place]
            if track.is_distractor and own[place] is None:
                target = self._target_filter.operations.move_to(
                    track.filter_state, as_box(predicted[place])
                )
                track = replace(track, filter_state=target)
            else:
                track = self._follow(
                    track,
                    predicted[place],
                    frame,
                    interval,
                    own=own[place],
                    expected=expected.get(place),
                    front=front,
                    ground=grounds.get(track.label),
                    is_alone=bool(alone[place]),
                    is_silent=is_silent,
                )
                if own[place] is None and track.is_undetected:
                    rivals = [one.distracted_key == track.key for one in tracks]
                    track = self._doubt(track, tracks[place], predicted[rivals])
            updated[place] = track
            if not _is_guess(track):
                front.append(track)
        return tuple(updated)

    def _expect(
        self,
        tracks: Sequence[Track],
        frame: Frame,
        interval: float,
        own: Sequence[Detection | None],
        alone: NDArray[np.bool_],
        *,
        is_silent: bool,
    ) -> dict[int, FramePrediction]:
        """Place of each target that will be followed to where it is expected.

        Those that others hid in the last frame are left out: most of them will be hidden again.
        """
        will_begin_anew = interval > _PAUSED_AFTER
        places, targets = [], []
        for place, (track, one) in enumerate(zip(tracks, own, strict=True)):
            if will_begin_anew if one else track.is_distractor or track.is_occluded_by_other:
                continue
            places.append(place)
            asks_for_size = bool(alone[place]) or _asks_for_size(track, one, is_silent)
            targets.append((track.filter_state, asks_for_size))
        return dict(zip(places, self._target_filter.predict(targets, frame, interval), strict=True))

    def count_misses(
        self, tracks: Sequence[Track], own: Sequence[Detection | None], detection_interval: float
    ) -> tuple[Track, ...]:
        """The targets, those that the detector did not find believed in less.

        Args:
            tracks: In the frame that it saw.
            own: The detection of each, None where there is none.
            detection_interval: Seconds since the frame that it saw before.
        """
        boxes = np.array([track.box for track in tracks]).reshape(-1, 4)
        lower = boxes[:, 1] + boxes[:, 3]
        hiding = pairwise_coverage(boxes, boxes) * (lower[None] > lower[:, None])
        visible = 1.0 - hiding.max(axis=1, initial=0.0)
        decided = 1.0 - math.exp(-detection_interval / _DECIDES_ANEW)
        loss = self._log_miss * decided * np.maximum(visible, _LEAST_VISIBLE)
        return tuple(
            track
            if one
            else replace(track, existence_log_odds=track.existence_log_odds + float(lost))
            for track, one, lost in zip(tracks, own, loss, strict=True)
        )

    def _follow(
        self,
        track: Track,
        predicted: NDArray[np.float64],
        frame: Frame,
        interval: float,
        *,
        own: Detection | None,
        expected: FramePrediction | None,
        front: Sequence[Track],
        ground: Ground | None,
        is_alone: bool,
        is_silent: bool,
    ) -> Track:
        """One target, behind others."""
        if own and interval > _PAUSED_AFTER:
            return self._begin_anew(track, frame, interval, own)
        target, is_occluded_by_other = track.filter_state, False
        is_sized = _is_sized(track, own, is_silent)
        evidence: list[ExternalLikelihood] = []
        if own:
            evidence.append(_of_detection(own.box))
        elif not is_alone:
            evidence.append(_of_course(track))
        if is_sized and not is_alone and ground and track.ground_box is not None:
            evidence.append(partial(ground.log_likelihood, track.ground_box))
        # What is taken for a rival may be none: only what it looks like yields to it.
        front = [one for one in front if one.distracted_key in (None, track.key)]
        boxes = np.array([one.box for one in front]).reshape(-1, 4)
        are_near = _are_near(boxes, predicted)
        front, boxes = list(compress(front, are_near)), boxes[are_near]
        if len(boxes):
            hidden = pairwise_coverage(predicted[None], boxes)[0]
            evidence.append(_of_others(boxes, hidden))
            # What is only like a target hides it where its course is sure; else it is looked for.
            is_sure = track.filter_state.estimate.confidence > _FULLY_ABOVE
            hides = np.array([is_sure or not one.is_distractor for one in front])
            is_occluded_by_other = own is None and bool((hidden * hides).max() > _HIDDEN_ABOVE)
        if not is_occluded_by_other:
            if expected is None:
                asked = (target, is_alone or _asks_for_size(track, own, is_silent))
                (expected,) = self._target_filter.predict([asked], frame, interval)
            followed = self._target_filter.step(
                expected, _all_of(evidence), searches_everywhere=is_alone
            )
            if own is None and len(boxes):
                found = np.array(followed.estimate.box)
                is_occluded_by_other = _is_on_one(found, boxes)
                is_on_rival = _is_on_one(found, boxes[[one.is_distractor for one in front]])
                known = followed.known_distractor if is_on_rival else target.known_distractor
                target = replace(target, known_distractor=known)
        center_filter, log_size = track.center_filter, track.log_size
        if is_occluded_by_other:
            target = self._target_filter.operations.coast(target, frame, interval)
            target = self._target_filter.operations.move_to(target, _inside(predicted, frame.size))
        else:
            target = followed
            if own is None:
                center_filter, log_size = _corrected_by_image(track, target)
        is_duplicate = is_occluded_by_other and track.unconfirmed_for > _DOUBLED_AFTER
        if is_duplicate:
            are_told = [not one.is_distractor for one in front]
            is_duplicate = _is_on_one(np.array(target.estimate.box), boxes[are_told])
        track = replace(
            track,
            filter_state=target,
            center_filter=center_filter,
            log_size=log_size,
            age=track.age + interval,
            unconfirmed_for=track.unconfirmed_for + interval,
            time_since_template_update=track.time_since_template_update + interval,
            is_occluded_by_other=is_occluded_by_other,
            is_duplicate=is_duplicate,
        )
        return self._correct(track, frame, own) if own else track

    def _doubt(self, track: Track, before: Track, rivals: NDArray[np.float64]) -> Track:
        """A target that may be another one by now, without its course moved, and not told as seen.

        It is doubted from when it jumps to what was seen beside it, and the filter does not know
        that as something else, or from when it is on what looks like it. That ends where its course
        leads, and once it is lost: where it is found again is where it is.

        Args:
            track: In this frame.
            before: After the last one, its course in this frame.
            rivals: (K, 4) boxes of what looks like it.
        """
        target, box, last = track.filter_state, track.box, before.filter_state
        if last.status.state == "lost":
            return replace(track, may_have_switched=False)
        is_on_rival = pairwise_iou(box[None], rivals).max(initial=0.0) > _ON_RIVAL
        is_doubted = bool(is_on_rival) or (
            target.known_distractor is None and _has_jumped(last, box)
        )
        if not is_doubted and before.may_have_switched:
            variance = before.center_filter.center_variance + np.square(_IMAGE_SPREAD * box[2:])
            apart = box[:2] + box[2:] / 2 - before.center_filter.center
            is_doubted = bool((np.square(apart) / variance).sum() > _DOUBT_GATE)
        if not is_doubted:
            return replace(track, may_have_switched=False)
        if target.estimate.state == "tracking":
            target = replace(target, estimate=replace(target.estimate, state="occluded"))
        return replace(
            track, filter_state=target, center_filter=before.center_filter, may_have_switched=True
        )

    def _begin_anew(self, track: Track, frame: Frame, interval: float, own: Detection) -> Track:
        """A target that a detection shows after a pause, where its motion tells of no place."""
        target = self._target_filter.initialize(
            frame, as_box(own.box), track.filter_state.generator_state
        )
        track = replace(
            track,
            filter_state=target,
            age=track.age + interval,
            time_since_template_update=track.time_since_template_update + interval,
            is_occluded_by_other=False,
            is_duplicate=False,
        )
        return self._correct(track, frame, own)

    def _correct(self, track: Track, frame: Frame, own: Detection) -> Track:
        """A target that a detection confirms, with its box brought towards that."""
        box = track.box
        is_far = bool(pairwise_iou(box[None], own.box[None])[0, 0] < _FAR_BELOW)
        # Where the image is sure, it takes a second detection to say that it is wrong.
        is_doubted = is_far and track.filter_state.estimate.confidence > _SURE_ABOVE
        goes_over = is_far and not is_doubted
        share = 1.0 / min(track.hits + 1, _SIZES)
        log_size = track.log_size + share * (np.log(own.box[2:]) - track.log_size)
        size = np.exp(log_size)
        center, seen = box[:2] + box[2:] / 2, own.box[:2] + own.box[2:] / 2
        center = center + (1.0 if goes_over else _GAIN) * (seen - center)
        target = self._target_filter.operations.move_to(
            track.filter_state, as_box([*(center - size / 2), *size])
        )
        learns = goes_over or (track.time_since_template_update >= _LEARN_EVERY and not is_doubted)
        if learns:
            target = self._target_filter.operations.relearn(target, frame)
        track = track.update_descriptor(own.descriptor, self._appearance) if own.is_clear else track
        return replace(
            track.add_label_vote(own.label, own.score),
            filter_state=target,
            center_filter=track.center_filter.correct(seen, CENTER_STD * size),
            log_size=log_size,
            existence_log_odds=min(
                max(track.existence_log_odds, _LEAST_BELIEF) + _HIT, _MOST_BELIEF
            ),
            hits=track.hits + 1,
            unconfirmed_for=0.0,
            time_since_template_update=0.0 if learns else track.time_since_template_update,
            ground_box=track.ground_box
            if is_truncated(own.box, frame.size)
            else np.array(target.estimate.box),
        )


def _corrected_by_image(
    track: Track, target: FilterState
) -> tuple[CenterKalmanFilter, NDArray[np.float64]]:
    """The course and the (2,) log size of a target, corrected by where the image shows it."""
    log_size, box = track.log_size, np.array(target.estimate.box)
    deviation = _IMAGE_SPREAD * box[2:]
    if track.is_undetected:
        count = min(target.estimate.confidence / _FULLY_ABOVE, 1.0)
        deviation = deviation / max(count, _LEAST_COUNT)
        if target.status.state == "tracking":
            log_size = np.log(box[2:])
    return track.center_filter.correct(box[:2] + box[2:] / 2, deviation), log_size


def _is_guess(track: Track) -> bool:
    """Whether nobody knows where a target is; those of a detector end once it does not see them."""
    return track.is_manual and track.filter_state.estimate.state == "lost"


def _is_sized(track: Track, own: Detection | None, is_silent: bool) -> bool:
    """Whether the image has to tell a target's size."""
    return own is None and (track.is_undetected or is_silent)


def _asks_for_size(track: Track, own: Detection | None, is_silent: bool) -> bool:
    """Whether it has to in this frame."""
    is_due = track.filter_state.followed_frames % _SIZE_EVERY == 0
    return is_due and _is_sized(track, own, is_silent)


def _has_jumped(last: FilterState, box: NDArray[np.float64]) -> bool:
    """Whether a target has jumped to a (4,) box, where something was seen beside it before."""
    return (
        last.second_peak is not None
        and bool(are_same_place(box, last.second_peak))
        and bool(relative_center_distances(box, last.estimate.box) >= 1.0)
    )


def _inside(box: NDArray[np.float64], image_size: tuple[int, int]) -> Box:
    """A (4,) box moved until its center is in the image, as those of the particles are."""
    half = box[2:] / 2
    center = np.clip(box[:2] + half, 0.0, image_size)
    return as_box([*(center - half), *box[2:]])


def _are_alone(tracks: Sequence[Track], predicted: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which target is the only one, with no rival near its (4,) of the (N, 4) predictions."""
    is_only = sum(not track.is_distractor for track in tracks) == 1
    return np.array([is_only and _are_near(predicted, box).sum() == 1 for box in predicted], bool)


def _are_near(boxes: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(K,) which of (K, 4) boxes a target could overlap that is about at a (4,) place."""
    apart = np.abs(boxes[:, :2] + boxes[:, 2:] / 2 - place[:2] - place[2:] / 2)
    near: NDArray[np.bool_] = np.all(apart < boxes[:, 2:] / 2 + _NEAR * place[2:], axis=1)
    return near


def _is_on_one(box: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Whether a (4,) box is on the object of one of (K, 4) others."""
    return bool(pairwise_iou(box[None], others).max(initial=0.0) > _SAME_ABOVE)


def _of_detection(box: NDArray[np.float64]) -> ExternalLikelihood:
    """The factor of a detection: near it a box is likelier, up to that it may be wrong."""
    center, spread = box[:2] + box[2:] / 2, CENTER_STD * box[2:]

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        across = np.square((x + width / 2 - center[0]) / spread[0])
        down = np.square((y + height / 2 - center[1]) / spread[1])
        return np.log(_WRONG + (1.0 - _WRONG) * np.exp(-0.5 * (across + down)))

    return log_likelihood


def _of_course(track: Track) -> ExternalLikelihood:
    """The factor of how a target has moved: it seldom jumps aside."""
    center, size = track.center_filter.center, track.box[2:]
    variance = track.center_filter.center_variance + np.square(_IMAGE_SPREAD * size)

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
