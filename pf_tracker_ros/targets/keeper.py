"""How all targets go on from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pf_tracker_ros.appearances import build_appearance
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import Associator, Recognizer, tell_apart
from pf_tracker_ros.targets.detections import Sighting
from pf_tracker_ros.targets.finder import Finder
from pf_tracker_ros.targets.lifecycle import Deleter, Initiator
from pf_tracker_ros.targets.rivals import Rivals
from pf_tracker_ros.targets.tracks import Crowd
from pf_tracker_ros.targets.updater import Updater
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.target_filter import TargetFilter


class CrowdKeeper:
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
        self._deleter = Deleter(parameters.track.remember)
        self._recognizer = Recognizer(self.appearance)
        self._finder = Finder(target_filter, self.appearance)
        self._rivals = Rivals(self.initiator, target_filter.operations)

    def advance(
        self, crowd: Crowd, frame: Frame, interval: float, seen: Sequence[Sighting] | None
    ) -> Crowd:
        """The crowd one frame later.

        Args:
            crowd: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
            seen: What the detector found in it; None where it did not run.
        """
        idle_for, rhythm = crowd.idle_for + interval, crowd.rhythm
        if seen is not None:
            idle_for, rhythm = 0.0, idle_for
        crowd = replace(crowd, frame=crowd.frame + 1, idle_for=idle_for, rhythm=rhythm)
        if frame.camera_motion is not None:
            crowd = crowd.carried(frame.camera_motion)
        lives = tuple(life.predicted(interval) for life in crowd.lives)
        own: list[Sighting | None] = [None] * len(lives)
        if seen:
            for place, number in self._associator.assign(lives, seen).items():
                own[place] = seen[number]
            lives = tell_apart(lives, own, self.appearance)
        lives = self._updater.update(lives, frame, interval, own, idle_for)
        if seen is not None:
            lives = self._updater.count_misses(lives, own, rhythm)
        crowd = self.initiator.adopt(replace(crowd, lives=lives), own)
        crowd = self._deleter.end(crowd, frame.size, interval)
        crowd = self._rivals.move(crowd, interval)
        if seen is not None:
            taken = {id(one) for one in own}
            rest = [(place, one) for place, one in enumerate(seen) if id(one) not in taken]
            crowd = self.initiator.start(crowd, frame, rest)
            crowd = self._recognizer.recognize(crowd)
            crowd = self.initiator.confirm(crowd, frame.size)
        if len(crowd.lives) > 1:
            crowd = self._finder.find(crowd, frame)
        return self._rivals.start(crowd, frame, interval, is_seen=seen is not None)
