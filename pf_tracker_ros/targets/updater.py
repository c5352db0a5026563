"""Updates every track with the image and its detection, with occlusions between the targets.

1. Order the tracks: detected ones first, lost ones that are held last; otherwise the lower box
   first, since it is nearer to the camera.
2. Predict the particles of all tracks at once.
3. For each track, collect the likelihoods that multiply that of the image
   (`external_likelihoods.py`).
4. Update the particle filter. An occluded track coasts instead, at its predicted center.
5. Correct the Kalman filter; with a detection also the box, the descriptor and the log odds.
6. Where a detector ran, undetected tracks lose existence log odds (`count_misses`): the logarithm
   of 1 - recall, less where a confirmed target is hidden or any was missed a moment ago.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import Box, as_box, is_on_any, pairwise_coverage, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.box_kalman_filter import IMAGE_CENTER_STD, BoxKalmanFilter
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.external_likelihoods import external_likelihood
from pf_tracker_ros.targets.tracks import NO_DETECTOR_AFTER, Track, boxes_of
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import FramePrediction
from pf_tracker_ros.tracking.target_filter import TargetFilter
from pf_tracker_ros.values import replace

# Seconds since a detection for which the place of a bystander is known.
_KNOWN_FOR = 0.3
# Covered share of a target above which it is occluded.
_OCCLUDED_ABOVE = 0.5
# Largest distance of a target from its predicted place, in its own sides.
_NEAR = 1.5
# Share of the way to its detection that a box moves. It moves all of it below this intersection
# over union, unless the confidence of the track is above the last value.
_GAIN, _FAR_BELOW, _CONFIDENT_ABOVE = 0.5, 0.5, 0.9
# Seconds without a detection after which a track on the same object as its occluder is a duplicate.
_DUPLICATE_AFTER = 0.2
# Confidence from which on the estimate of an undetected target counts fully for its Kalman filter;
# the least that it counts.
_FULL_CONFIDENCE, _MIN_COUNT = 0.85, 0.05
# Frames from one size estimate in the image to the next: sizes change slowly, but that of a target
# that a robot follows is its distance.
_SIZE_EVERY = 2
# Seconds between two template updates by detections.
_LEARN_EVERY = 0.4
# Seconds without detections after which sizes are estimated in the image.
_SILENT_AFTER = 2.0
# Existence log odds: what a detection adds, their minimum before that, and their maximum.
_HIT_LOG_ODDS, _MIN_LOG_ODDS, _MAX_LOG_ODDS = 2.0, -1.0, 1.5
# Time constant, seconds, after which two misses are independent.
_INDEPENDENT_AFTER = 0.3
# Seconds without a frame after which a track starts again from its detection: the particles are too
# few for the area in which it may be.
_PAUSED_AFTER = 1.0
# Minimum of the visible share, which scales the effect of a miss.
_MIN_VISIBLE = 0.4


class _Scene(NamedTuple):
    """What all tracks of a frame share.

    A detector is silent if there were no detections for so long that the image tells the sizes. See
    `TrackAssessor.assess` for the challenge.
    """

    frame: Frame
    interval: float
    is_silent: bool
    is_challenged: bool


class Updater:
    """Updates the tracks, the one in front first.

    Targets explain their own pixels: a box on a target in front is less likely for those behind.
    Lost manual targets occlude nothing, since their place is unknown. Without detections, the size
    comes from the image. A single target, without a distractor nearby or a detector, uses the image
    alone, and is searched for in the whole image once it is lost.

    The recall is the share of the visible targets that the detector finds.
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
        assigned: Sequence[Detection | None],
        time_since_detection: float,
    ) -> tuple[Track, ...]:
        """The tracks one frame later, whose centers are predicted into that frame."""
        has_no_detector = time_since_detection > NO_DETECTOR_AFTER
        if has_no_detector:
            tracks = [_without_detector(track) for track in tracks]
            if len(tracks) == 1 and assigned[0] is None and not tracks[0].is_distractor:
                return (self._update_alone(tracks[0], frame, interval),)
        updated = list(tracks)
        boxes = np.array([track.predicted_box for track in tracks]).reshape(-1, 4)
        front: list[Track] = []
        lower_edges = boxes[:, 1] + boxes[:, 3]
        undetected = np.array([one is None for one in assigned], dtype=np.bool_)
        unknown = np.array([_is_place_unknown(track) for track in tracks], dtype=np.bool_)
        alone = _are_alone(tracks, boxes) & has_no_detector
        scene = _Scene(
            frame,
            interval,
            is_silent=time_since_detection > _SILENT_AFTER,
            is_challenged=has_no_detector and sum(not one.is_distractor for one in tracks) == 1,
        )
        predictions = self._predict(tracks, scene, assigned, alone)
        for index in np.lexsort((-lower_edges, undetected & unknown, undetected)).tolist():
            track = tracks[index]
            if track.is_distractor:
                track = self._update_distractor(track, frame, interval, assigned[index])
            else:
                track = self._update_track(
                    track,
                    boxes[index],
                    scene,
                    detection=assigned[index],
                    frame_prediction=predictions.get(index),
                    front=front,
                    is_alone=bool(alone[index]),
                )
            updated[index] = track
            if not _is_place_unknown(track):
                front.append(track)
        return tuple(updated)

    def _update_alone(self, track: Track, frame: Frame, interval: float) -> Track:
        """The only track, without a detector: the image alone says where it is."""
        target_filter = self._target_filter
        (prediction,) = target_filter.predict([(track.filter_state, True)], frame, interval)
        stepped = target_filter.step(prediction)
        filter_state, box_filter = self._correct_by_image(track, stepped, is_sized=True)
        return track.older(interval, filter_state=filter_state, box_filter=box_filter)

    def _predict(
        self,
        tracks: Sequence[Track],
        scene: _Scene,
        assigned: Sequence[Detection | None],
        alone: NDArray[np.bool_],
    ) -> dict[int, FramePrediction]:
        """Index to prediction, of the tracks whose filters will probably be updated.

        Tracks that were occluded in the last frame are left out: most still are.
        """
        is_paused = scene.interval > _PAUSED_AFTER
        indices, states = [], []
        for index, (track, detection) in enumerate(zip(tracks, assigned, strict=True)):
            is_left_out = is_paused if detection else track.is_occluded_by_other
            if track.is_distractor or is_left_out:
                continue
            indices.append(index)
            estimates_size = bool(alone[index]) or _is_size_due(track, detection, scene.is_silent)
            states.append((track.filter_state, estimates_size))
        predictions = self._target_filter.predict(states, scene.frame, scene.interval)
        return dict(zip(indices, predictions, strict=True))

    def count_misses(
        self,
        tracks: Sequence[Track],
        assigned: Sequence[Detection | None],
        detection_interval: float,
    ) -> tuple[Track, ...]:
        """The tracks, with lower existence log odds where no detection was assigned.

        `detection_interval` is the time since the last frame with detections.
        """
        boxes = boxes_of(tracks)
        lower_edges = boxes[:, 1] + boxes[:, 3]
        covered = pairwise_coverage(boxes, boxes) * (lower_edges[None] > lower_edges[:, None])
        visible = np.maximum(1.0 - covered.max(axis=1, initial=0.0), _MIN_VISIBLE)
        # What was never confirmed is not hidden, but most likely nothing.
        visible[[not (track.is_confirmed or track.is_manual) for track in tracks]] = 1.0
        independence = 1.0 - math.exp(-detection_interval / _INDEPENDENT_AFTER)
        changes = self._log_miss * independence * visible
        return tuple(
            track if detection else track.with_existence(track.existence_log_odds + float(change))
            for track, detection, change in zip(tracks, assigned, changes, strict=True)
        )

    def _update_distractor(
        self, track: Track, frame: Frame, interval: float, detection: Detection | None
    ) -> Track:
        """A distractor where it is predicted, or detected; its own filter is not used."""
        filter_state = self._target_filter.operations.move_to(
            track.filter_state, as_box(track.predicted_box)
        )
        track = track.older(interval, filter_state=filter_state)
        return self._correct(track, frame, detection) if detection else track

    def _update_track(
        self,
        track: Track,
        predicted_box: NDArray[np.float64],
        scene: _Scene,
        *,
        detection: Detection | None,
        frame_prediction: FramePrediction | None,
        front: Sequence[Track],
        is_alone: bool,
    ) -> Track:
        """One track, behind the tracks in front."""
        frame, interval = scene.frame, scene.interval
        if detection:
            is_found = track.is_missing and self._looks_alike(track, detection)
            if is_found or interval > _PAUSED_AFTER:
                return self._reinitialize(track, frame, interval, detection, is_found=is_found)
        front, boxes = _near_in_front(track, predicted_box, front)
        covered = pairwise_coverage(predicted_box[None], boxes)[0]
        # Who is in front is seen by depth, where there is one.
        is_clear = track.filter_state.occlusion_evidence.is_clear
        hiding = np.array([_may_hide(one) for one in front], dtype=np.bool_)
        is_occluded_by_other = (
            detection is None and not is_clear and _is_covered(track, front, covered * hiding)
        )
        is_sized = _needs_size(track, detection, scene.is_silent)
        filter_state, box_filter = track.filter_state, track.box_filter
        if not is_occluded_by_other:
            if frame_prediction is None:
                estimates_size = is_alone or _is_size_due(track, detection, scene.is_silent)
                (frame_prediction,) = self._target_filter.predict(
                    [(filter_state, estimates_size)], frame, interval
                )
            likelihood = None
            if len(boxes) or not is_alone:
                likelihood = external_likelihood(
                    track, detection, boxes, covered, is_alone=is_alone
                )
            stepped = self._target_filter.step(
                frame_prediction,
                likelihood,
                searches_everywhere=is_alone,
                is_challenged=scene.is_challenged,
            )
            if detection is None and len(boxes):
                box = np.array(stepped.estimate.box)
                is_occluded_by_other = not is_clear and is_on_any(box, boxes[hiding])
                is_on_distractor = is_on_any(box, boxes[[one.is_distractor for one in front]])
                known = (stepped if is_on_distractor else filter_state).known_distractor
                filter_state = replace(filter_state, known_distractor=known)
        if is_occluded_by_other:
            operations = self._target_filter.operations
            filter_state = operations.coast(filter_state, frame, interval)
            filter_state = operations.move_to(
                filter_state, _with_center_inside(predicted_box, frame.size)
            )
        else:
            filter_state = stepped
            if detection is None:
                filter_state, box_filter = self._correct_by_image(track, stepped, is_sized)
        is_duplicate = is_occluded_by_other and track.unconfirmed_for > _DUPLICATE_AFTER
        if is_duplicate:
            are_targets = [not one.is_distractor for one in front]
            is_duplicate = is_on_any(np.array(filter_state.estimate.box), boxes[are_targets])
        track = track.older(
            interval,
            filter_state=filter_state,
            box_filter=box_filter,
            is_occluded_by_other=is_occluded_by_other,
            is_duplicate=is_duplicate,
        )
        return self._correct(track, frame, detection) if detection else track

    def _looks_alike(self, track: Track, detection: Detection) -> bool:
        (distance,) = self._appearance.distance(track.descriptor, detection.descriptor[None])
        return bool(distance < track.largest_distance)

    def _reinitialize(
        self,
        track: Track,
        frame: Frame,
        interval: float,
        detection: Detection,
        *,
        is_found: bool,
    ) -> Track:
        """A track that starts from its detection.

        After a pause, which no motion model spans, or where it was missing: then its particles and
        templates are those of something else.
        """
        filter_state = self._target_filter.initialize(
            frame, as_box(detection.box), track.filter_state.generator_state
        )
        track = track.older(interval, filter_state=filter_state)
        return self._correct(track, frame, detection, is_found=is_found)

    def _correct_by_image(
        self, track: Track, filter_state: FilterState, is_sized: bool
    ) -> tuple[FilterState, BoxKalmanFilter]:
        """The particle filter and the Kalman filter of an undetected track, one after the other.

        The Kalman filter takes over the center. The size of either becomes that of the other: of
        the particle filter, in this frame, if it comes from the image (`is_sized`).
        """
        box, box_filter = np.array(filter_state.estimate.box), track.box_filter
        center, std = box[:2] + box[2:] / 2, IMAGE_CENTER_STD * box[2:]
        if track.is_undetected:
            count = min(filter_state.confidence / _FULL_CONFIDENCE, 1.0)
            std = std / max(count, _MIN_COUNT)
        if not is_sized:
            box = np.concatenate([center - box_filter.size / 2, box_filter.size])
            filter_state = self._target_filter.operations.move_to(filter_state, as_box(box))
        elif filter_state.status.state == "tracking":
            box_filter = box_filter.with_size(box[2:])
        return filter_state, box_filter.correct_center(center, std)

    def _correct(
        self, track: Track, frame: Frame, detection: Detection, *, is_found: bool = False
    ) -> Track:
        """A track with a hit, its box moved towards the detection; `is_found` if it was missing."""
        box = track.box
        places = np.array([box, track.predicted_box])
        is_far, is_unexpected = pairwise_iou(places, detection.box[None])[:, 0] < _FAR_BELOW
        # Against a confident image, one distant detection is not enough; the image is wrong where
        # the detections before it expect it.
        is_confident = track.filter_state.confidence > _CONFIDENT_ABOVE
        is_doubted = is_far and is_unexpected and is_confident
        jumps = is_far and not is_doubted
        box_filter = track.box_filter.correct(detection.box, track.unconfirmed_for)
        size = box_filter.size
        center = box[:2] + box[2:] / 2
        detected = detection.box[:2] + detection.box[2:] / 2
        center = center + (1.0 if jumps else _GAIN) * (detected - center)
        operations = self._target_filter.operations
        filter_state = operations.move_to(track.filter_state, as_box([*(center - size / 2), *size]))
        is_due = track.time_since_template_update >= _LEARN_EVERY
        relearns = jumps or (is_due and not is_doubted)
        if relearns:
            filter_state = operations.relearn(filter_state, frame)
        if detection.is_clear:
            track = track.update_descriptor(detection.descriptor, self._appearance)
        log_odds = max(track.existence_log_odds, _MIN_LOG_ODDS) + _HIT_LOG_ODDS
        track = replace(
            track.add_label_vote(detection.label, detection.score),
            filter_state=filter_state,
            box_filter=box_filter,
            hits=track.hits + 1,
            unconfirmed_for=0.0,
            time_since_template_update=0.0 if relearns else track.time_since_template_update,
        )
        return track.with_existence(min(log_odds, _MAX_LOG_ODDS), is_found=is_found)


def _without_detector(track: Track) -> Track:
    """A track whose image no detector supports or contradicts any more."""
    if track.filter_state.detector_factor == 1.0:
        return track
    return replace(track, filter_state=replace(track.filter_state, detector_factor=1.0))


def _is_place_unknown(track: Track) -> bool:
    """Whether a track is a lost one that is held; others end once no detector finds them."""
    return track.is_held and track.filter_state.estimate.state == "lost"


def _needs_size(track: Track, detection: Detection | None, is_silent: bool) -> bool:
    """Whether the size of a track comes from the image.

    That of the selected one does between detections, too: it tells a robot the distance.
    """
    return detection is None and (track.is_undetected or track.is_selected or is_silent)


def _is_size_due(track: Track, detection: Detection | None, is_silent: bool) -> bool:
    """Whether its size is estimated in this frame."""
    is_due = track.is_selected or track.filter_state.followed_frames % _SIZE_EVERY == 0
    return is_due and _needs_size(track, detection, is_silent)


def _with_center_inside(box: NDArray[np.float64], image_size: tuple[int, int]) -> Box:
    """A (4,) box moved until its center is in the image, as are those of the particles."""
    half = box[2:] / 2
    center = np.clip(box[:2] + half, 0.0, image_size)
    return as_box([*(center - half), *box[2:]])


def _near_in_front(
    track: Track, predicted_box: NDArray[np.float64], front: Sequence[Track]
) -> tuple[list[Track], NDArray[np.float64]]:
    """The K tracks in front that a target may overlap, and their (K, 4) boxes."""
    # A distractor may be none: it occludes only the target that it looks like.
    front = [one for one in front if one.distracted_key in (None, track.key)]
    boxes = boxes_of(front)
    are_near = _are_near(boxes, predicted_box)
    return list(compress(front, are_near)), boxes[are_near]


def _may_hide(track: Track) -> bool:
    """Whether the place of a track is known well enough to say that another is behind it.

    The place of a bystander is only predicted between detections.
    """
    return not (track.is_distractor and track.hits and track.unconfirmed_for > _KNOWN_FOR)


def _is_covered(track: Track, front: Sequence[Track], covered: NDArray[np.float64]) -> bool:
    """Whether one of K tracks in front occludes a target, given the (K,) shares that they cover."""
    # A distractor occludes only a confident target.
    is_confident = track.filter_state.confidence > _FULL_CONFIDENCE
    return any(
        share > _OCCLUDED_ABOVE and (is_confident or not one.is_distractor)
        for one, share in zip(front, covered, strict=True)
    )


def _are_alone(tracks: Sequence[Track], boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) the only target, with no distractor near its box of the (N, 4) predicted ones."""
    is_only = sum(not track.is_distractor for track in tracks) == 1
    return np.array([is_only and _are_near(boxes, box).sum() == 1 for box in boxes], bool)


def _are_near(boxes: NDArray[np.float64], predicted_box: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(K,) which of (K, 4) boxes a target may overlap, given its (4,) predicted box."""
    offsets = boxes[:, :2] + boxes[:, 2:] / 2 - predicted_box[:2] - predicted_box[2:] / 2
    return np.all(np.abs(offsets) < boxes[:, 2:] / 2 + _NEAR * predicted_box[2:], axis=1)
