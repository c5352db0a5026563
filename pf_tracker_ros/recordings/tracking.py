"""Track the target of a recording as the node does that is shown it in lockstep."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import cv2
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage.prefetch import Prefetch
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.overlay import draw_overlay
from pf_tracker_ros.recordings.errors import WRONG_TARGET, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.targets.tracker import Tracker

SKIPPED = ("refused", "duplicate", "late")
"""What becomes of a frame that is not looked at, as the node's status says it."""


class TargetRow(NamedTuple):
    """What is known of one target after a frame.

    Attributes:
        id: Its number, None where there is no target.
        state: As the status has it, of a frame without a target that of the frame.
        box: (x, y, width, height) in pixels; None where the node publishes none.
        confidence: 0 to 1, None where it is unknown.
        label: What it is, as far as anybody said so, or empty.
    """

    id: int | None
    state: str
    box: Box | None
    confidence: float | None
    label: str = ""


class Tracked(Protocol):
    """One frame of a recording, and what was made of it.

    Attributes:
        frame: The frame.
        outcome: "started", "tracked", "waiting", "duplicate", "late" or "refused".
        problem: Why the frame was refused, or empty.
        seconds: What the tracker took for it.
        state: `skipped`, `idle`, or the state of the target that is seen best.
        remarks: What else was refused or came to an end with the frame, a sentence each.
        rows: What is known of each target, at least one.
    """

    @property
    def frame(self) -> RecordedFrame: ...  # noqa: D102
    @property
    def outcome(self) -> str: ...  # noqa: D102
    @property
    def problem(self) -> str: ...  # noqa: D102
    @property
    def seconds(self) -> float: ...  # noqa: D102
    @property
    def state(self) -> str: ...  # noqa: D102
    @property
    def remarks(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def rows(self) -> tuple[TargetRow, ...]: ...  # noqa: D102

    def draw(self) -> NDArray[Any]:
        """The picture that the node would publish on `~/overlay`.

        Raises:
            ValueError: The frame has no image.
        """
        ...


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """One frame of a recording, and what the tracker makes of it.

    Attributes:
        frame: The frame.
        outcome: "started", "tracked", "waiting", "duplicate", "late" or "refused".
        estimate: What is known after it; None while there is no target, and where the frame was not
            looked at.
        problem: Why the frame was refused, or empty.
        seconds: What the tracker took for it.
        target_id: Number of the target.
        remarks: Of a single target there are none.
    """

    frame: RecordedFrame
    outcome: str
    estimate: Estimate | None
    problem: str
    seconds: float
    target_id: int = 1
    remarks: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the state of the track, as the node's status has it."""
        if self.outcome in SKIPPED:
            return "skipped"
        return self.estimate.state if self.estimate else "idle"

    @property
    def box(self) -> Box | None:
        """(x, y, width, height) in pixels; None where the node publishes no box."""
        if self.estimate is None or self.estimate.state == "lost":
            return None
        return self.estimate.box

    @property
    def rows(self) -> tuple[TargetRow, ...]:
        """What is known of the target."""
        confidence = self.estimate.confidence if self.estimate else None
        return (TargetRow(self.target_id, self.state, self.box, confidence),)

    def draw(self) -> NDArray[Any]:
        """See `Tracked.draw`."""
        text = f"{self.estimate.state} {self.estimate.confidence:.2f}" if self.estimate else ""
        return draw_overlay(image_of(self.frame), self.estimate, text or "no target")


def image_of(frame: RecordedFrame) -> NDArray[Any]:
    """The image of a frame.

    Raises:
        ValueError: It has none.
    """
    if frame.image is None:
        raise ValueError(frame.problem)
    return frame.image


def track_recording(
    recording: Recording,
    target: Target,
    preset: str = "default",
    parameters: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Generator[TrackedFrame, None, None]:
    """Track a target through a recording.

    The frames go through the same `Session` as those of the node, so the boxes are those that it
    publishes for a replay in lockstep. Frames are read ahead in a thread.

    Args:
        recording: What to track in.
        target: What to track.
        preset: Name of a preset.
        parameters: Full name to value, where they differ from the preset's.
        seed: As for `Tracker`.

    Yields:
        Every frame, in order.

    Raises:
        ParameterError: A parameter is not allowed.
        RecordingError: The target is refused, or of another recording.
        FootageError: The recording cannot be read, or not any further.
    """
    tunables = Tracker.from_preset(preset, seed=seed, parameters=parameters or {}).parameters
    session = Session(tunables, seed)
    has_started = False
    with one_opencv_thread(), closing(Prefetch(recording.frames())) as frames:
        for frame in frames:
            if not has_started:
                box = target.box_in(frame)
                if box is not None:
                    _request(session, box, frame, target)
                    has_started = True
            yield _tracked(session, frame, target)
    if not has_started:
        raise target.missed()


def _request(session: Session, box: Box, frame: RecordedFrame, target: Target) -> None:
    try:
        session.request(box, frame.stamp)
    except ValueError as error:
        raise RecordingError(
            f"frame {frame.index}, box from {target.source}: {error}", WRONG_TARGET
        ) from error


def _tracked(session: Session, frame: RecordedFrame, target: Target) -> TrackedFrame:
    began = time.perf_counter()
    try:
        outcome = session.process(Frame(image_of(frame), frame.stamp))
    except (ValueError, cv2.error) as error:
        return TrackedFrame(frame, "refused", None, str(error), time.perf_counter() - began)
    seconds = time.perf_counter() - began
    if "; ".join(outcome.refused):
        raise RecordingError(
            f"frame {frame.index}, box from {target.source}: {'; '.join(outcome.refused)}", WRONG_TARGET
        )
    estimate = None if outcome.frame in SKIPPED else outcome.estimate
    return TrackedFrame(frame, outcome.frame, estimate, "", seconds)
