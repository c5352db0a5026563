"""Track the targets of a recording as the node does that follows several, shown it in lockstep."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import cv2
from numpy.typing import NDArray

from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.overlay import draw_targets
from pf_tracker_ros.recordings.detections.hearing import Hearing
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.recordings.tracking import SKIPPED, TargetRow, image_of
from pf_tracker_ros.targets.multi_tracker import MultiTracker
from pf_tracker_ros.targets.session import MultiSession
from pf_tracker_ros.targets.statuses import best_state
from pf_tracker_ros.targets.tracked_target import TrackedTarget

# As the node's parameters `history_frames` and `history_megabytes` have them: late detections count
# in what is kept.
_HISTORY = (120, 64.0)


@dataclass(frozen=True, eq=False)
class TrackedTargets:
    """One frame of a recording, and what a tracker of several targets makes of it.

    Attributes:
        frame: The frame.
        outcome: "started", "tracked", "waiting", "duplicate", "late" or "refused".
        targets: The targets after it; none where it was not looked at.
        heard: Number of the answers of detectors so far.
        problem: Why the frame was refused, or empty.
        seconds: What the tracker took for it.
        remarks: Which detections were no use, and which targets ended for the images' sake.
    """

    frame: RecordedFrame
    outcome: str
    targets: tuple[TrackedTarget, ...]
    heard: int
    problem: str = ""
    seconds: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the state of the target that is seen best."""
        return "skipped" if self.outcome in SKIPPED else best_state(self.targets)

    @property
    def rows(self) -> tuple[TargetRow, ...]:
        """What is known of each target; one row without an id where there is none."""
        return tuple(row_of(target) for target in self.targets) or (
            TargetRow(None, self.state, None, None),
        )

    def draw(self) -> NDArray[Any]:
        """See `Tracked.draw`."""
        return draw_targets(image_of(self.frame), self.targets)


def row_of(target: TrackedTarget) -> TargetRow:
    """What is known of a target."""
    estimate = target.estimate
    box = None if estimate.state == "lost" else estimate.box
    return TargetRow(target.id, estimate.state, box, estimate.confidence, target.label)


def track_targets(
    recording: Recording,
    targets: Sequence[Target],
    hearing: Hearing | None,
    *,
    preset: str = "default",
    parameters: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Generator[TrackedTargets, None, None]:
    """Track several targets through a recording.

    The frames go through the same `MultiSession` as those of the node whose `max_targets` is
    `targets.most`, so ids and boxes are those that it publishes for a replay in lockstep.

    Args:
        recording: What to track in.
        targets: What to track, besides what a detector finds.
        hearing: Hears what a detector says, None for none; used up with this.
        preset: Name of a preset.
        parameters: Full name to value, where they differ from the preset's for several targets.
        seed: As for `MultiTracker`.

    Yields:
        Every frame, in order.

    Raises:
        ParameterError: A parameter is not allowed.
        RecordingError: A target is refused, or targets or detections are of another recording.
        FootageError: The recording cannot be read, or not any further.
    """
    tracking = _Tracking(targets, hearing, preset, parameters or {}, seed)
    count = 0
    with one_opencv_thread(), closing(Prefetch(recording.frames())) as frames:
        for frame in frames:
            count += 1
            yield tracking.take(frame)
        tracking.finish(count)


class _Tracking:
    """One way through a recording.

    Args:
        As for `track_targets`.
    """

    def __init__(
        self,
        targets: Sequence[Target],
        hearing: Hearing | None,
        preset: str,
        parameters: Mapping[str, Any],
        seed: int,
    ) -> None:
        values = MultiTracker.from_preset(preset, seed, parameters).parameters
        self._session = MultiSession(values, seed)
        self._session.history.limit(*_HISTORY)
        self._waiting = list(targets)
        self._asked_for: list[Target] = []
        self._labels: dict[int, str] = {}
        self._hearing = hearing
        self._heard = 0

    def take(self, frame: RecordedFrame) -> TrackedTargets:
        """Track into a frame."""
        refused = self._hear(frame)
        self._request(frame)
        began = time.perf_counter()
        try:
            outcome = self._session.process_unread(lambda: image_of(frame), frame.stamp)
        except (ValueError, cv2.error) as error:
            seconds = time.perf_counter() - began
            return TrackedTargets(
                frame, "refused", (), self._heard, str(error), seconds, tuple(refused)
            )
        seconds = time.perf_counter() - began
        if self._hearing:
            self._hearing.after(frame, outcome)
        if outcome.refused:
            raise _refused(frame, self._asked_for, "; ".join(outcome.refused))
        for id in outcome.started:
            self._labels[id] = self._asked_for.pop(0).label
        known = () if outcome.frame in SKIPPED else outcome.targets
        remarks = (*refused, *outcome.ended, *outcome.left_out)
        known = tuple(map(self._labeled, known))
        return TrackedTargets(frame, outcome.frame, known, self._heard, "", seconds, remarks)

    def finish(self, frame_count: int) -> None:
        """Take that the recording has ended.

        Raises:
            RecordingError: It has not all frames that were spoken of.
        """
        if self._waiting:
            raise self._waiting[0].missed()
        if self._hearing:
            self._hearing.finish(frame_count)

    def _hear(self, frame: RecordedFrame) -> list[str]:
        """Take what detectors have said before a frame; why it was refused."""
        refused = []
        for answer in self._hearing.before(frame) if self._hearing else ():
            reason = answer.refused
            if answer.detections is not None:
                self._heard += 1
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
