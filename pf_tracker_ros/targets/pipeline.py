"""Advances all tracks by one frame, as tracking by detection with a particle filter per target.

1. Predict: camera motion compensation, then a Kalman prediction of each center.
2. Associate: detections are assigned to tracks, and identity switches corrected.
3. Update: the particle filter of each target, then the existence log odds.
4. Delete: tracks that are not detected any more or have left the image.
5. Initiate: tracks on unassigned detections, re-identified with lost ones where they match.
6. Redetect: lost targets without a detector, by their appearance.
7. Distractors: objects that look like a target get tracks of their own.

Steps 2 and 5 run on frames with detections only. The stages are those of Deep SORT (Wojke, Bewley
and Paulus 2017) and of Stone Soup.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pf_tracker_ros.appearances import build_appearance
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.appearance_redetection import AppearanceRedetector
from pf_tracker_ros.targets.association import (
    Associator,
    ReIdentifier,
    correct_id_switches,
    learn_others,
)
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.distractors import DistractorManager
from pf_tracker_ros.targets.hinted import with_hint
from pf_tracker_ros.targets.lifecycle import Deleter, Initiator
from pf_tracker_ros.targets.tracks import TrackKey, TrackSet
from pf_tracker_ros.targets.updater import Updater
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.target_filter import TargetFilter
from pf_tracker_ros.values import replace


class TrackingPipeline:
    """Turns one track set into that of the next frame; has no state of its own."""

    def __init__(
        self, target_filter: TargetFilter, parameters: TrackerParameters, seed: int
    ) -> None:
        self._target_filter = target_filter
        self.appearance = build_appearance(parameters.appearance)
        self._associator = Associator(self.appearance)
        self._updater = Updater(target_filter, parameters.detector.recall, self.appearance)
        self.initiator = Initiator(target_filter, seed, parameters.max_targets, self.appearance)
        self._deleter = Deleter(parameters.track.reidentify_within, parameters.track.keep_selected)
        self._reidentifier = ReIdentifier(self.appearance)
        self._redetector = AppearanceRedetector(target_filter, self.appearance)
        self._distractors = DistractorManager(self.initiator, target_filter.operations)

    def take_hints(
        self, track_set: TrackSet, hints: Mapping[TrackKey, Hint], image_size: tuple[int, int]
    ) -> TrackSet:
        """The track set after the last frame, with the hints of that frame."""
        operations = self._target_filter.operations
        return track_set.with_tracks(
            with_hint(track, hints[track.key], image_size, operations)
            if track.key in hints
            else track
            for track in track_set.tracks
        )

    def advance(
        self,
        track_set: TrackSet,
        frame: Frame,
        interval: float,
        detections: Sequence[Detection] | None,
    ) -> TrackSet:
        """The track set one frame later; `detections` are None where no detector ran."""
        time_since_detection = track_set.time_since_detection + interval
        detection_interval = track_set.detection_interval
        if detections is not None:
            time_since_detection, detection_interval = 0.0, time_since_detection
        track_set = replace(
            track_set,
            frame=track_set.frame + 1,
            time_since_detection=time_since_detection,
            detection_interval=detection_interval,
        )
        if frame.camera_motion is not None:
            track_set = track_set.compensate_camera_motion(frame.camera_motion)
        tracks = tuple(
            track.predict(interval, track_set.growth_variance) for track in track_set.tracks
        )
        assigned: list[Detection | None] = [None] * len(tracks)
        if detections:
            for index, number in self._associator.assign(tracks, detections).items():
                assigned[index] = detections[number]
            tracks = correct_id_switches(tracks, assigned, self.appearance)
            tracks = learn_others(tracks, assigned, detections, self.appearance)
        tracks = self._updater.update(tracks, frame, interval, assigned, time_since_detection)
        if detections is not None:
            tracks = self._updater.count_misses(tracks, assigned, detection_interval)
        track_set = replace(track_set, tracks=tracks)
        if detections is not None:
            track_set = track_set.learn_growth()
            track_set = self.initiator.promote_distractors(track_set, assigned)
        # Only a user ends manual tracks.
        if track_set.ended_tracks or not all(track.is_manual for track in track_set.tracks):
            track_set = self._deleter.delete_tracks(track_set, frame.size, interval)
        track_set = self._distractors.update(track_set, interval)
        if detections is not None:
            used = {id(one) for one in assigned}
            unassigned = [
                (number, one) for number, one in enumerate(detections) if id(one) not in used
            ]
            track_set = self.initiator.initiate(track_set, frame, unassigned)
            track_set = self._reidentifier.reidentify(track_set)
            track_set = self.initiator.discard_doubtful(track_set)
            track_set = self.initiator.confirm(track_set, frame.size)
        if len(track_set.tracks) > 1:
            track_set = self._redetector.find(track_set, frame)
        return self._distractors.initiate(
            track_set, frame, interval, has_detections=detections is not None
        )
