"""How all targets go on from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pf_tracker_ros.appearances import build_appearance
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.appearance_redetection import AppearanceRedetector
from pf_tracker_ros.targets.association import Associator, ReIdentifier, correct_id_switches
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.distractors import DistractorManager
from pf_tracker_ros.targets.lifecycle import Deleter, Initiator
from pf_tracker_ros.targets.tracks import TrackSet
from pf_tracker_ros.targets.updater import Updater
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.target_filter import TargetFilter


class TrackingPipeline:
    """Makes the crowd of a frame out of the one before; holds the roles, and nothing of a target.

    Args:
        target_filter: Follows each target.
        parameters: Every tunable.
        seed: Seeds all randomness.
    """

    def __init__(
        self, target_filter: TargetFilter, parameters: TrackerParameters, seed: int
    ) -> None:
        self.appearance = build_appearance(parameters.appearance)
        self._associator = Associator(self.appearance)
        self._updater = Updater(target_filter, parameters.detector.recall, self.appearance)
        self.initiator = Initiator(target_filter, seed, parameters.max_targets, self.appearance)
        self._deleter = Deleter(parameters.track.reidentify_within)
        self._recognizer = ReIdentifier(self.appearance)
        self._finder = AppearanceRedetector(target_filter, self.appearance)
        self._distractors = DistractorManager(self.initiator, target_filter.operations)

    def advance(
        self, track_set: TrackSet, frame: Frame, interval: float, seen: Sequence[Detection] | None
    ) -> TrackSet:
        """The crowd one frame later.

        Args:
            track_set: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
            seen: What the detector found in it; None where it did not run.
        """
        time_since_detection, detection_interval = (
            track_set.time_since_detection + interval,
            track_set.detection_interval,
        )
        if seen is not None:
            time_since_detection, detection_interval = 0.0, time_since_detection
        track_set = replace(
            track_set,
            frame=track_set.frame + 1,
            time_since_detection=time_since_detection,
            detection_interval=detection_interval,
        )
        if frame.camera_motion is not None:
            track_set = track_set.compensate_camera_motion(frame.camera_motion)
        tracks = tuple(track.predict(interval) for track in track_set.tracks)
        own: list[Detection | None] = [None] * len(tracks)
        if seen:
            for place, number in self._associator.assign(tracks, seen).items():
                own[place] = seen[number]
            tracks = correct_id_switches(tracks, own, self.appearance)
        tracks = self._updater.update(tracks, frame, interval, own, time_since_detection)
        if seen is not None:
            tracks = self._updater.count_misses(tracks, own, detection_interval)
        track_set = self.initiator.promote_distractors(replace(track_set, tracks=tracks), own)
        track_set = self._deleter.delete_tracks(track_set, frame.size, interval)
        track_set = self._distractors.update(track_set, interval)
        if seen is not None:
            taken = {id(one) for one in own}
            rest = [(place, one) for place, one in enumerate(seen) if id(one) not in taken]
            track_set = self.initiator.initiate(track_set, frame, rest)
            track_set = self._recognizer.reidentify(track_set)
            track_set = self.initiator.confirm(track_set, frame.size)
        if len(track_set.tracks) > 1:
            track_set = self._finder.find(track_set, frame)
        return self._distractors.initiate(track_set, frame, interval, is_seen=seen is not None)
