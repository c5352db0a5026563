"""Tracks one recording into its output files, for `track` and for each recording of an archive."""

from __future__ import annotations

import argparse
import signal
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Protocol

from pf_tracker_ros.command_lines import missing_package
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import OnProgress, progress_bar
from pf_tracker_ros.recordings import errors
from pf_tracker_ros.recordings.archives.sources import name_source_in
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.keyframes.summary import KeyframeSummary
from pf_tracker_ros.recordings.output_files import OutputFolder, check_outputs, open_outputs
from pf_tracker_ros.recordings.plan import (
    Plan,
    check_applies,
    make_plan,
    open_from_options,
    uses_detector,
)
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.signals import handled_signals

_SIGNALS = {signal.SIGINT: errors.INTERRUPTED, signal.SIGTERM: errors.TERMINATED}
_SKIP_REASONS = {
    "duplicate": "its stamp equals that of the previous frame",
    "late": "its stamp is earlier than that of the previous frame",
}


@dataclass
class Stop:
    """The exit code of a received signal, and whether the first one interrupts at once."""

    exit_code: int = 0
    at_once: bool = False

    def handled(self) -> AbstractContextManager[None]:
        """Stop by SIGINT or SIGTERM within a block, after the current frame on the first signal.

        Raises:
            KeyboardInterrupt: On the second signal, or with `at_once`.
        """
        return handled_signals(dict.fromkeys(_SIGNALS, self._on_signal))

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Stop at once on a signal within a block, also on one that came before.

        Raises:
            KeyboardInterrupt: On a signal.
        """
        self.at_once = True
        try:
            if self.exit_code:
                raise KeyboardInterrupt
            yield
        finally:
            self.at_once = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        is_second = bool(self.exit_code)
        self.exit_code = _SIGNALS[signal.Signals(number)]
        if is_second or self.at_once:
            raise KeyboardInterrupt

    @property
    def word(self) -> str:
        """The reason, for messages."""
        return "terminated" if self.exit_code == errors.TERMINATED else "interrupted"


@dataclass
class RunSummary:
    """How tracking a recording went.

    Attributes:
        target_source: Origin of targets that are not given on the command line, or empty.
        is_multi_target: Whether `max_targets` is above 1.
        exit_code: Of `track`.
        errors: Why it did not end well, a sentence each.
        states: State to number of frames.
        notes: Warnings about the recording as a whole.
        seconds: Duration of the tracking.
        is_live: Whether a camera was tracked, which has no end: Ctrl-C ends it well.
    """

    target_source: str = ""
    is_multi_target: bool = False
    exit_code: int = errors.DONE
    errors: list[str] = field(default_factory=list)
    states: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
    is_live: bool = False
    _skip_reason: str = ""
    _first_warning: str = ""
    _warning_count: int = 0
    _ids: set[int] = field(default_factory=set)
    # Frames in which a target has a position; None without positions.
    _located: int | None = None
    _keyframes: KeyframeSummary = field(default_factory=KeyframeSummary)

    def add(self, tracked: TrackedFrame) -> None:
        """Add a frame."""
        self.states[tracked.state] += 1
        self._keyframes.add(tracked)
        reason = tracked.problem or _SKIP_REASONS.get(tracked.outcome, "")
        self._skip_reason = self._skip_reason or reason
        if tracked.warnings and not self._first_warning:
            self._first_warning = f"frame {tracked.frame.index}: {tracked.warnings[0]}"
        self._warning_count += len(tracked.warnings)
        self._ids.update(target.id for target in tracked.targets)
        if tracked.located:
            self._located = (self._located or 0) + bool(tracked.located.world_targets)

    def add_failures(self, failures: Sequence[Exception], stop: Stop) -> None:
        """Add the errors, and a signal."""
        # A file that cannot be written usually cannot be closed either: the same message, once.
        for failure in {str(failure): failure for failure in failures}.values():
            code = getattr(failure, "exit_code", errors.UNREADABLE_SOURCE)
            self.exit_code = self.exit_code or code
            verb = "was" if self.frames == 1 else "were"
            kept = f"; {counted(self.frames, 'frame')} {verb} tracked" if self.frames else ""
            self.errors.append(f"{failure}{kept}")
        if stop.exit_code and not (self.is_live and stop.exit_code == errors.INTERRUPTED):
            self.errors.append(f"{stop.word}; {counted(self.frames, 'frame')} saved")
            self.exit_code = stop.exit_code

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.states.total()

    @property
    def warnings(self) -> list[str]:
        """What is unusual, a sentence each; none after errors."""
        if self.errors:
            return []
        warnings = [*self.notes]
        if self._skip_reason:
            warnings.append(f"frames were skipped, the first because {self._skip_reason}")
        if self._first_warning:
            warnings.append(
                f"{counted(self._warning_count, 'warning')} on detections and targets, first: "
                f"{self._first_warning} (frames counted from 0)"
            )
        return warnings

    @property
    def lines(self) -> list[str]:
        """The figures, as lines to print."""
        shares = ", ".join(
            f"{count / self.frames:.0%} {state}" for state, count in self.states.most_common()
        )
        rate = self.frames / self.seconds if self.seconds else 0.0
        if self._ids and self.is_multi_target:
            shares = f"best state in each frame: {shares}"
        targets = f", {counted(len(self._ids), 'target')}" if self.is_multi_target else ""
        if self._located is not None:
            targets += f", positions, also of hidden targets, in {self._located / self.frames:.0%}"
        origin = f"; target from {self.target_source}" if self.target_source else ""
        line = f"{counted(self.frames, 'frame')} ({shares}){targets}, {rate:.0f} frames/s{origin}"
        return [line, self._keyframes.text] if self._keyframes.given else [line]


def check_packages(options: argparse.Namespace) -> None:
    """Check that the packages for the outputs are installed.

    Raises:
        RecordingError: One is missing.
    """
    for package, extra, is_used in (
        ("rich", "recordings", True),
        ("yaml", "recordings", True),
        ("rosbags", "recordings", options.bag),
        ("pyarrow", "parquet", options.parquet),
        ("matplotlib", "recordings", options.report is not None),
        ("jinja2", "recordings", options.report is not None),
        ("aiohttp", "console", options.draw),
        ("scipy", "targets", uses_detector(options)),
    ):
        if is_used and (missing := missing_package(package, extra)):
            raise RecordingError(missing)


class Watcher(Protocol):
    """Somebody who draws the targets, and watches the tracking."""

    def ask(self, recording: Recording, max_targets: int) -> tuple[Target, ...]:
        """Let the user draw the targets; see `DrawTargets`."""

    def show(self, tracked: TrackedFrame) -> None:
        """Show a tracked frame."""


def run_recording(
    options: argparse.Namespace,
    path: Path | str,
    name: str,
    stop: Stop,
    watcher: Watcher | None = None,
) -> RunSummary:
    """Track a recording, and write the files of the options.

    Args:
        options: Of the command line; with an archive, the recording is one of it.
        path: Of the recording, or of its local copy; or a camera.
        name: Path or URL of the recording, for reports and errors.
        stop: Ends it.
        watcher: Draws the targets; None for targets from elsewhere.

    Raises:
        FootageError: The recording cannot be read at all.
        RecordingError: The request is invalid; nothing was tracked.
        ParameterError: A parameter is invalid.
    """
    recording = open_from_options(path, options)
    if options.archive is None:
        check_applies(options, recording)
    check_outputs(options, path)
    with closing(make_plan(recording, options, watcher.ask if watcher else None)) as plan:
        summary = RunSummary(_target_source(options, plan), plan.max_targets > 1)
        summary.is_live = recording.is_live
        outputs = open_outputs(options, plan, name)
        try:
            failures = _track_into(outputs, plan, summary, stop, options, watcher=watcher)
            for failure in failures:
                if isinstance(path, Path):
                    name_source_in(failure, name, path)
            failures += [failure for folder in outputs for failure in folder.close()]
            summary.notes += [note for folder in outputs for note in folder.notes]
        except BaseException:
            for folder in outputs:
                folder.discard()
            raise
        summary.add_failures(failures, stop)
        source = plan.detection_source
        if source and source.warning:
            advice = "" if plan.targets else ", or --box starts a target without it"
            summary.notes.append(f"{source.warning}{advice}")
        return summary


def _track_into(
    outputs: Sequence[OutputFolder],
    plan: Plan,
    summary: RunSummary,
    stop: Stop,
    options: argparse.Namespace,
    *,
    watcher: Watcher | None,
) -> list[FootageError | RecordingError]:
    """Track until the end of the recording or a signal; returns what ended it early.

    Raises:
        FootageError, RecordingError: There are no results to keep.
    """
    recording, started_at = plan.recording, time.monotonic()
    bar: AbstractContextManager[OnProgress] = progress_bar(
        recording.frame_count, name=recording.path.name, shown=options.archive is None
    )
    try:
        with bar as on_progress, closing(plan.track()) as frames:
            for tracked in frames:
                for folder in outputs:
                    folder.write(tracked)
                if watcher:
                    watcher.show(tracked)
                summary.add(tracked)
                on_progress(recording.path.name, 1)
                if stop.exit_code:
                    break
    except (FootageError, RecordingError) as error:
        # Without a target and without a detector, there are no results to keep.
        is_idle = summary.states.keys() <= {"idle", "skipped"}
        if not summary.frames or (is_idle and not plan.detection_source):
            raise
        if not options.allow_partial or isinstance(error, RecordingError):
            return [error]
        summary.notes.append(str(error))
    else:
        summary.notes += plan.positions.notes if plan.positions else []
    finally:
        summary.seconds = time.monotonic() - started_at
        if recording.note:
            summary.notes.insert(0, recording.note)
    return []


def _target_source(options: argparse.Namespace, plan: Plan) -> str:
    """The origin of targets that are not given on the command line, or empty."""
    if not plan.targets or options.box or options.draw:
        return ""
    is_true_box = plan.targets[0].box is None
    return "the ground truth" if is_true_box else target_file(plan.recording.path).name
