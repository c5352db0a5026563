"""Tracks the targets of a recording, with the results of the node in a lockstep replay.

For each frame:
1. Detections that arrived since the previous frame are added to the session.
2. Targets whose first box is in this frame are requested.
3. The session tracks into the frame.
4. The detection source receives the frame, for a built-in detector.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import cv2

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.recordings.detections import DetectionSource
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.targets.multi_tracker import DEFAULT_MAX_TARGETS
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Outcome, Session
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.topics import SKIPPED, FrameResult
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.presets import preset_parameters

# Defaults of the node's parameters `frame_buffer_length` and `frame_buffer_megabytes`: late
# detections are applied to buffered frames only.
_FRAME_BUFFER_LIMITS = (120, 64.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedFrame(FrameResult):
    """One frame of a recording, and the tracker's result. A skipped frame has no targets.

    Attributes:
        frame: The frame.
        outcome: "started", "tracked", "waiting", "duplicate", "late" or "refused".
        problem: Why the frame was refused, or empty.
        seconds: Processing time.
        warnings: A sentence for each rejected detection, and for each target that ended because of
            the images.
        to_check: Id of a target to the reason why a person should look at its box; with keyframes.
        keyframes: Ids of the targets whose box a person has given in this frame.
        located: The positions in meters; None if they are not wanted.
    """

    frame: RecordedFrame
    outcome: str
    problem: str = ""
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    to_check: Mapping[int, str] = field(default_factory=dict)
    keyframes: frozenset[int] = frozenset()
    located: LocatedFrame | None = None

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the state of the selected target, else of the best one."""
        return "skipped" if self.outcome in SKIPPED else super().state

    @property
    def box(self) -> Box | None:
        """(x, y, width, height) of the selected target; None if the node publishes none."""
        return published_box(self.estimate)


Tracking = Generator[TrackedFrame, Mapping[int, Hint] | None, None]
"""Tracked frames in order; takes the hints of a frame, see `Session`, before the next."""


def published_box(estimate: Estimate | None) -> Box | None:
    """The box of an estimate; None for a lost target or no estimate."""
    return None if estimate is None or estimate.state == "lost" else estimate.box


def tracker_parameters(
    preset: str,
    parameters: Mapping[str, Any],
    targets: Sequence[Target] = (),
    *,
    with_detector: bool = False,
) -> dict[str, Any]:
    """The value of every parameter.

    Args:
        preset: Name of a preset.
        parameters: Full name to value, where they differ from the preset's. The default of
            `max_targets` is 1 for one target without a detector, else 32.
        targets: The given targets.
        with_detector: Whether detections start targets.

    Raises:
        ParameterError: There is no such preset.
        RecordingError: There are more targets than `max_targets`.
    """
    default = 1 if len(targets) == 1 and not with_detector else DEFAULT_MAX_TARGETS
    given = parameters.get("max_targets", default)
    # The session rejects other types, with the name of the parameter.
    max_targets = given if isinstance(given, int) else default
    if len(targets) > max_targets:
        raise RecordingError(
            f"there are {len(targets)} targets, but 'max_targets' is {max_targets}; raise it, or "
            "give fewer targets",
            WRONG_TARGET,
        )
    return {**preset_parameters(preset, max_targets), **parameters}


def track_recording(
    recording: Recording,
    targets: Target | Sequence[Target],
    detection_source: DetectionSource | None = None,
    *,
    preset: str = "default",
    parameters: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Tracking:
    """Track targets through a recording.

    The frames go through the same `Session` as in the node, so ids and boxes equal those that it
    publishes in a lockstep replay. A thread prefetches the frames.

    Args:
        recording: To track in.
        targets: To track. Detections may start others.
        detection_source: Source of detections, or None; can be used once.
        preset: Name of a preset.
        parameters: As for `tracker_parameters`.
        seed: As for `Tracker`.

    Yields:
        Every frame, in order.

    Raises:
        ParameterError: A parameter is invalid.
        RecordingError: A target is refused, or targets or detections belong to another recording.
        FootageError: The recording cannot be read, or only in part.
    """
    targets = [targets] if isinstance(targets, Target) else targets
    with_detector = detection_source is not None
    values = tracker_parameters(preset, parameters or {}, targets, with_detector=with_detector)
    tracking = _Tracking(targets, detection_source, values, seed)
    count = 0
    with one_opencv_thread(), closing(Prefetch(recording.frames())) as frames:
        for frame in frames:
            count += 1
            hints = yield tracking.process(frame)
            if hints:
                tracking.take_hints(hints, frame)
        tracking.finish(count)


class _Tracking:
    """One pass through a recording, with the values of all parameters."""

    def __init__(
        self,
        targets: Sequence[Target],
        detection_source: DetectionSource | None,
        values: Mapping[str, Any],
        seed: int,
    ) -> None:
        self._session = Session(values, seed)
        if detection_source is not None:
            self._session.frame_buffer.limit(*_FRAME_BUFFER_LIMITS)
        self._max_targets: int = values["max_targets"]
        self._pending = list(targets)
        self._requested: list[Target] = []
        self._labels: dict[int, str] = {}
        self._detection_source = detection_source or DetectionSource()

    def process(self, frame: RecordedFrame) -> TrackedFrame:
        """Track into a frame."""
        detection_errors = self._add_detections(frame)
        self._request_targets(frame)
        problem = ""
        started_at = time.perf_counter()
        try:
            outcome = self._session_outcome(frame)
        except (ValueError, cv2.error) as error:
            # Without an image there is no result, as for a late frame.
            outcome, problem = Outcome("late"), str(error)
        seconds = time.perf_counter() - started_at
        self._detection_source.on_frame(frame, outcome)
        if outcome.refused:
            raise _target_error(frame, self._requested, "; ".join(outcome.refused))
        for id in outcome.started:
            self._labels[id] = self._requested.pop(0).label
        is_tracked = outcome.frame not in SKIPPED
        return TrackedFrame(
            frame=frame,
            outcome="refused" if problem else outcome.frame,
            targets=tuple(map(self._labeled, outcome.targets)) if is_tracked else (),
            selected=outcome.selected,
            max_targets=self._max_targets,
            detector_runs=self._session.detector_runs,
            image=frame.image,
            problem=problem,
            seconds=seconds,
            warnings=(*detection_errors, *outcome.ended, *outcome.rejected_detections),
        )

    def take_hints(self, hints: Mapping[int, Hint], frame: RecordedFrame) -> None:
        """Take what is known of the targets in a frame."""
        self._session.set_hints(hints, frame.stamp)

    def _session_outcome(self, frame: RecordedFrame) -> Outcome:
        arrival = self._session.classify(frame.stamp)
        if arrival in DROPPED_ARRIVALS:
            return self._session.drop(arrival)
        if frame.decoded is None:
            raise ValueError(frame.problem)
        return self._session.process(frame.decoded, arrival)

    def finish(self, frame_count: int) -> None:
        """End the pass; raises RecordingError if the frame of a target or detection is missing."""
        if self._pending:
            raise self._pending[0].not_found_error()
        self._detection_source.finish(frame_count)

    def _add_detections(self, frame: RecordedFrame) -> list[str]:
        """Add the detections that arrived before a frame; return the errors."""
        errors = []
        for output in self._detection_source.detections_before(frame):
            error = output.error
            if output.detections is not None:
                try:
                    self._session.add_detections(output.detections, output.stamp)
                except ValueError as refusal:
                    error = f"detections refused: {refusal}"
            if error:
                errors.append(error)
        return errors

    def _request_targets(self, frame: RecordedFrame) -> None:
        """Request the targets whose first box is in a frame."""
        for target in [*self._pending]:
            box = target.box_in(frame)
            if box is None:
                continue
            self._pending.remove(target)
            try:
                # Without its label, as in a message to the node.
                self._session.request(box, frame.stamp)
            except ValueError as error:
                raise _target_error(frame, [target], str(error)) from error
            self._requested.append(target)

    def _labeled(self, target: TrackedTarget) -> TrackedTarget:
        """The target with its given label, unless detections have labeled it."""
        return replace(target, label=target.label or self._labels.get(target.id, ""))


def _target_error(frame: RecordedFrame, targets: Sequence[Target], reason: str) -> RecordingError:
    sources = ", ".join(dict.fromkeys(target.source for target in targets))
    return RecordingError(f"frame {frame.index}, box from {sources}: {reason}", WRONG_TARGET)
