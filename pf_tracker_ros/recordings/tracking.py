"""Track the targets of a recording as the node does that is shown it in lockstep."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import cv2

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.recordings.detections.source import DetectionSource
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.targets.multi_tracker import DEFAULT_MAX_TARGETS
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Outcome, Session
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.topics import FrameResult
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.presets import preset_parameters

SKIPPED = ("refused", *DROPPED_ARRIVALS)
"""What becomes of a frame that is not looked at, as the node's status says it."""

# As the node's parameters `frame_buffer_length` and `frame_buffer_megabytes` have them: late detections count
# in what is kept.
_HISTORY = (120, 64.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedFrame(FrameResult):
    """One frame of a recording, and what the tracker makes of it.

    Of a frame that was not looked at, there are no targets.

    Attributes:
        frame: The frame.
        outcome: "started", "tracked", "waiting", "duplicate", "late" or "refused".
        problem: Why the frame was refused, or empty.
        seconds: What the tracker took for it.
        warnings: Which detections were no use, and which targets ended for the images' sake, a
            sentence each.
    """

    frame: RecordedFrame
    outcome: str
    problem: str = ""
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the state of the selected target, without one of that seen best."""
        return "skipped" if self.outcome in SKIPPED else super().state

    @property
    def box(self) -> Box | None:
        """(x, y, width, height) of the selected target; None where the node publishes none."""
        return published_box(self.estimate)


def published_box(estimate: Estimate | None) -> Box | None:
    """The box of an estimate; None of a target that is lost, and without one."""
    return None if estimate is None or estimate.state == "lost" else estimate.box


def tracker_parameters(
    preset: str,
    parameters: Mapping[str, Any],
    targets: Sequence[Target] = (),
    *,
    with_detector: bool = False,
) -> dict[str, Any]:
    """The value of every parameter for some targets.

    Args:
        preset: Name of a preset.
        parameters: Full name to value, where they differ from the preset's; `max_targets` is 1 for
            one target and no detector, and else 32, where it is not given.
        targets: To be tracked.
        with_detector: Whether a detector starts targets, too.

    Raises:
        ParameterError: There is no such preset.
        RecordingError: There are more targets than there may be.
    """
    usual = 1 if len(targets) == 1 and not with_detector else DEFAULT_MAX_TARGETS
    given = parameters.get("max_targets", usual)
    # What is no number is refused by its name, with all values.
    most = given if isinstance(given, int) else usual
    if len(targets) > most:
        raise RecordingError(
            f"{len(targets)} targets are given, and 'max_targets' is {most}; allowed: no more",
            WRONG_TARGET,
        )
    return {**preset_parameters(preset, most), **parameters}


def track_recording(
    recording: Recording,
    targets: Target | Sequence[Target],
    detection_source: DetectionSource | None = None,
    *,
    preset: str = "default",
    parameters: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Generator[TrackedFrame, None, None]:
    """Track targets through a recording.

    The frames go through the same `Session` as those of the node, so ids and boxes are those that
    it publishes for a replay in lockstep. Frames are read ahead in a thread.

    Args:
        recording: What to track in.
        targets: What to track, besides what a detector finds.
        detection_source: Hears what a detector says, None for none; used up with this.
        preset: Name of a preset.
        parameters: Full name to value, where they differ from the preset's; `max_targets` is 1 for
            one target and no detector, and else 32, where it is not given.
        seed: As for `Tracker`.

    Yields:
        Every frame, in order.

    Raises:
        ParameterError: A parameter is not allowed.
        RecordingError: A target is refused, or targets or detections are of another recording.
        FootageError: The recording cannot be read, or not any further.
    """
    wanted = [targets] if isinstance(targets, Target) else targets
    with_detector = detection_source is not None
    values = tracker_parameters(preset, parameters or {}, wanted, with_detector=with_detector)
    tracking = _Tracking(wanted, detection_source, values, seed)
    count = 0
    with one_opencv_thread(), closing(Prefetch(recording.frames())) as frames:
        for frame in frames:
            count += 1
            yield tracking.take(frame)
        tracking.finish(count)


class _Tracking:
    """One way through a recording.

    Args:
        targets: As for `track_recording`.
        detection_source: As for `track_recording`.
        values: Of all parameters.
        seed: As for `track_recording`.
    """

    def __init__(
        self,
        targets: Sequence[Target],
        detection_source: DetectionSource | None,
        values: Mapping[str, Any],
        seed: int,
    ) -> None:
        self._session = Session(values, seed)
        if detection_source is not None:
            self._session.frame_buffer.limit(*_HISTORY)
        self._max_targets: int = values["max_targets"]
        self._waiting = list(targets)
        self._asked_for: list[Target] = []
        self._labels: dict[int, str] = {}
        self._detection_source = detection_source or DetectionSource()

    def take(self, frame: RecordedFrame) -> TrackedFrame:
        """Track into a frame."""
        refused = self._hear(frame)
        self._request(frame)
        problem = ""
        began = time.perf_counter()
        try:
            outcome = self._process(frame)
        except (ValueError, cv2.error) as error:
            # What is known of it is as little as of one that came late.
            outcome, problem = Outcome("late"), str(error)
        seconds = time.perf_counter() - began
        self._detection_source.on_frame(frame, outcome)
        if outcome.refused:
            raise _refused(frame, self._asked_for, "; ".join(outcome.refused))
        for id in outcome.started:
            self._labels[id] = self._asked_for.pop(0).label
        is_seen = outcome.frame not in SKIPPED
        return TrackedFrame(
            frame=frame,
            outcome="refused" if problem else outcome.frame,
            targets=tuple(map(self._labeled, outcome.targets)) if is_seen else (),
            selected=outcome.selected,
            max_targets=self._max_targets,
            detector_runs=self._session.detector_runs,
            image=frame.image,
            problem=problem,
            seconds=seconds,
            warnings=(*refused, *outcome.ended, *outcome.rejected_detections),
        )

    def _process(self, frame: RecordedFrame) -> Outcome:
        arrival = self._session.classify(frame.stamp)
        if arrival in DROPPED_ARRIVALS:
            return self._session.drop(arrival)
        if frame.decoded is None:
            raise ValueError(frame.problem)
        return self._session.process(frame.decoded, arrival)

    def finish(self, frame_count: int) -> None:
        """Take that the recording has ended.

        Raises:
            RecordingError: It has not all frames that were spoken of.
        """
        if self._waiting:
            raise self._waiting[0].missed()
        self._detection_source.finish(frame_count)

    def _hear(self, frame: RecordedFrame) -> list[str]:
        """Take what detectors have said before a frame; why it was refused."""
        refused = []
        for answer in self._detection_source.detections_before(frame):
            reason = answer.error
            if answer.detections is not None:
                try:
                    self._session.add_detections(answer.detections, answer.stamp)
                except ValueError as error:
                    reason = f"detections refused: {error}"
            if reason:
                refused.append(reason)
        return refused

    def _request(self, frame: RecordedFrame) -> None:
        """Ask for the targets that were drawn on a frame."""
        for target in [*self._waiting]:
            box = target.box_in(frame)
            if box is None:
                continue
            self._waiting.remove(target)
            try:
                # Without its label, which a target that is sent to the node has not either.
                self._session.request(box, frame.stamp)
            except ValueError as error:
                raise _refused(frame, [target], str(error)) from error
            self._asked_for.append(target)

    def _labeled(self, target: TrackedTarget) -> TrackedTarget:
        """The same, under the label that it was drawn with while no detector calls it anything."""
        return replace(target, label=target.label or self._labels.get(target.id, ""))


def _refused(frame: RecordedFrame, targets: Sequence[Target], reason: str) -> RecordingError:
    sources = ", ".join(dict.fromkeys(target.source for target in targets))
    return RecordingError(f"frame {frame.index}, box from {sources}: {reason}", WRONG_TARGET)
