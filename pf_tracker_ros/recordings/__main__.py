"""The command `track`: tracks targets through a recording and writes the results to files."""

from __future__ import annotations

import argparse
import functools
import io
import signal
import sys
import time
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from pf_tracker_ros.command_lines import missing_package, print_error
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.opencv import quiet_opencv
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.recordings import errors
from pf_tracker_ros.recordings.archives.command import run_archive
from pf_tracker_ros.recordings.archives.sources import (
    errors_name_source,
    local_copy,
    name_source_in,
)
from pf_tracker_ros.recordings.archives.stores import is_url, parse_path_or_url
from pf_tracker_ros.recordings.command_line import parser
from pf_tracker_ros.recordings.errors import RecordingError, unwritable
from pf_tracker_ros.recordings.files import check_outputs, open_outputs
from pf_tracker_ros.recordings.keyframes.summary import KeyframeSummary
from pf_tracker_ros.recordings.output_folder import OutputFolder
from pf_tracker_ros.recordings.plan import (
    SIDECAR,
    Plan,
    apply_parameter_file,
    check_applies,
    check_request,
    make_plan,
    open_from_options,
    uses_detector,
)
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, save_targets
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.signals import handled_signals

_SIGNALS = {signal.SIGINT: errors.INTERRUPTED, signal.SIGTERM: errors.TERMINATED}
_SKIP_REASONS = {
    "duplicate": "its stamp equals that of the previous frame",
    "late": "its stamp is earlier than that of the previous frame",
}


@dataclass
class _Summary:
    """The summary that is printed at the end of a recording."""

    target_source: str = ""
    is_multi_target: bool = False
    states: Counter[str] = field(default_factory=Counter)
    skip_reason: str = ""
    first_warning: str = ""
    warning_count: int = 0
    # Warnings about the recording as a whole.
    notes: list[str] = field(default_factory=list)
    ids: set[int] = field(default_factory=set)
    # Frames in which a target has a position; None without positions.
    located: int | None = None
    seconds: float = 0.0
    keyframes: KeyframeSummary = field(default_factory=KeyframeSummary)

    def add(self, tracked: TrackedFrame) -> None:
        self.states[tracked.state] += 1
        self.keyframes.add(tracked)
        reason = tracked.problem or _SKIP_REASONS.get(tracked.outcome, "")
        self.skip_reason = self.skip_reason or reason
        if tracked.warnings and not self.first_warning:
            self.first_warning = f"frame {tracked.frame.index}: {tracked.warnings[0]}"
        self.warning_count += len(tracked.warnings)
        self.ids.update(target.id for target in tracked.targets)
        if tracked.located:
            self.located = (self.located or 0) + bool(tracked.located.world_targets)

    @property
    def frames(self) -> int:
        return self.states.total()

    @property
    def text(self) -> str:
        shares = ", ".join(
            f"{count / self.frames:.0%} {state}" for state, count in self.states.most_common()
        )
        rate = self.frames / self.seconds if self.seconds else 0.0
        if self.ids and self.is_multi_target:
            shares = f"best target: {shares}"
        targets = f", {counted(len(self.ids), 'target')}" if self.is_multi_target else ""
        if self.located is not None:
            targets += f", positions in {self.located / self.frames:.0%}"
        origin = f"; target from {self.target_source}" if self.target_source else ""
        return f"{counted(self.frames, 'frame')} ({shares}){targets}, {rate:.0f} frames/s{origin}"


def main(arguments: Sequence[str] | None = None, source_name: str | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without the program's name; None means that of this process.
        source_name: Path or URL of a recording of an archive, for reports and errors; None for a
            single recording.

    Returns:
        Exit code as listed by `track --help`. A line on standard error explains any but 0.
    """
    stop = _Stop()
    handlers = dict.fromkeys(_SIGNALS, stop.on_signal)
    try:
        with handled_signals(handlers), quiet_opencv(), _escaping_output():
            return _run(parser().parse_args(arguments), stop, source_name)
    except FootageError as error:
        return _print_error(error, errors.UNREADABLE_SOURCE)
    except RecordingError as error:
        return _print_error(error, error.exit_code)
    except (EvaluationError, ParameterError) as error:
        return _print_error(error, errors.REFUSED)
    except KeyboardInterrupt:
        exit_code = stop.exit_code or errors.INTERRUPTED
        return _print_error(f"{stop.word}; unfinished files were discarded", exit_code)


def _run(options: argparse.Namespace, stop: _Stop, source_name: str | None) -> int:
    # Errors of the request are reported before the first frame, not after an hour of tracking.
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
    _check_options(options)
    apply_parameter_file(options)
    check_request(options)
    if options.archive is not None:
        stop.at_once = True
        return run_archive(options)
    with local_copy(parse_path_or_url(options.source)) as path:
        name = source_name or options.source
        with errors_name_source(name, path):
            return _run_one(options, path, name, stop, is_archived=source_name is not None)


def _check_options(options: argparse.Namespace) -> None:
    """Check the options of a single recording."""
    if options.archive is not None:
        return
    for option in ("dry_run", "ray", "jobs"):
        if getattr(options, option):
            name = f"--{option.replace('_', '-')}"
            raise RecordingError(f"{name} applies to archives; add --archive FOLDER_OR_LIST")
    if not options.source:
        message = "SOURCE is missing; give a recording, or --archive FOLDER_OR_LIST"
        for option in ("detections", "report", "keyframes"):
            value = getattr(options, option)
            if value not in (None, SIDECAR):
                message += f" ({value} was read as the value of --{option}: put SOURCE first)"
        raise RecordingError(message)
    for option in ("box", "draw", "detections", "detections_topic", "detector"):
        if options.keyframes is not None and getattr(options, option):
            name = f"--{option.replace('_', '-')}"
            raise RecordingError(f"--keyframes and {name} exclude each other; give one of them")
    if options.draw and options.box:
        raise RecordingError("--draw and --box exclude each other; give one of them")
    if is_url(options.output):
        raise RecordingError(
            f"--output {options.output} is a URL; allowed for a single recording: a folder"
        )


def _run_one(
    options: argparse.Namespace, path: Path, name: str, stop: _Stop, *, is_archived: bool
) -> int:
    recording = open_from_options(path, options)
    if not is_archived:
        check_applies(options, recording)
    check_outputs(options)
    draw = functools.partial(_draw, recording, options, stop) if options.draw else None
    with closing(make_plan(recording, options, draw, is_archived=is_archived)) as plan:
        return _run_plan(options, plan, name, stop)


def _run_plan(options: argparse.Namespace, plan: Plan, name: str, stop: _Stop) -> int:
    outputs = open_outputs(options, plan, name)
    summary = _Summary(_target_source(options, plan), plan.max_targets > 1)
    failures: list[Exception] = []
    try:
        try:
            _track(plan.track(), plan.recording, outputs, summary, stop)
            summary.notes += plan.positions.notes if plan.positions else []
        except (FootageError, RecordingError) as error:
            # Without a target and without a detector, there are no results to keep.
            is_idle = summary.states.keys() <= {"idle", "skipped"}
            if not summary.frames or (is_idle and not plan.detection_source):
                raise
            name_source_in(error, name, plan.recording.path)
            if options.allow_partial and isinstance(error, FootageError):
                summary.notes.append(str(error))
            else:
                failures.append(error)
        for folder in outputs:
            failures += folder.close()
    except BaseException:
        for folder in outputs:
            folder.discard()
        raise
    warning = plan.detection_source.warning if plan.detection_source else ""
    if warning and not plan.targets:
        warning += ", or --box starts a target without it"
    return _report(options, summary, stop, failures, warning)


def _target_source(options: argparse.Namespace, plan: Plan) -> str:
    """The origin of targets that are not given on the command line, or empty."""
    if not plan.targets or options.box or options.draw:
        return ""
    is_true_box = plan.targets[0].box is None
    return "the ground truth" if is_true_box else target_file(plan.recording.path).name


def _draw(
    recording: Recording, options: argparse.Namespace, stop: _Stop, max_targets: int
) -> tuple[Target, ...]:
    """Let the user draw the targets on a page, and save them beside the recording if possible."""
    from pf_tracker_ros.recordings.drawing.server import prompt_for_targets

    stop.at_once = True
    try:
        targets = prompt_for_targets(recording, max_targets, _print_url)
    except KeyboardInterrupt:
        raise RecordingError(
            f"{stop.word} before a target was drawn; nothing was tracked", stop.exit_code
        ) from None
    finally:
        stop.at_once = False
    if is_url(options.source):
        saved = "not saved, because the recording has a URL"
    else:
        saved = _save(targets, recording.path)
    boxes = "; ".join(
        f"{','.join(f'{value:.10g}' for value in target.box or ())} in frame {target.frame}"
        for target in targets
    )
    print(f"target{'s' if len(targets) > 1 else ''} {boxes}, {saved}", flush=True)
    return targets


def _print_url(url: str) -> None:
    print(f"draw the targets at {url} (Ctrl-C cancels)", flush=True)


def _save(targets: Sequence[Target], source: Path) -> str:
    """Save the target file of a recording; return the outcome as part of a sentence."""
    try:
        return f"saved as {save_targets(targets, source)}"
    except FileExistsError:
        return f"not saved, because {target_file(source)} exists already (remove it first)"
    except OSError as error:
        return f"not saved, because {unwritable(target_file(source), error)}"


def _track(
    tracking: Generator[TrackedFrame, None, None],
    recording: Recording,
    outputs: Sequence[OutputFolder],
    summary: _Summary,
    stop: _Stop,
) -> None:
    started_at = time.monotonic()
    try:
        with (
            progress_bar(recording.frame_count, name=recording.path.name) as on_progress,
            closing(tracking) as frames,
        ):
            for tracked in frames:
                for folder in outputs:
                    folder.write(tracked)
                summary.add(tracked)
                on_progress(recording.path.name, 1)
                if stop.exit_code:
                    return
    finally:
        summary.seconds = time.monotonic() - started_at
        if recording.note:
            summary.notes.append(recording.note)


def _report(
    options: argparse.Namespace,
    summary: _Summary,
    stop: _Stop,
    failures: list[Exception],
    warning: str,
) -> int:
    """Print the errors, or the warnings (the last one on the detector) and the summary.

    Returns:
        Exit code.
    """
    exit_code = errors.DONE
    # A file that cannot be written usually cannot be closed either: the same message, once.
    for failure in {str(failure): failure for failure in failures}.values():
        failure_code = getattr(failure, "exit_code", errors.UNREADABLE_SOURCE)
        exit_code = exit_code or failure_code
        verb = "was" if summary.frames == 1 else "were"
        kept = f"; {counted(summary.frames, 'frame')} {verb} tracked" if summary.frames else ""
        _print_error(f"{failure}{kept}", failure_code)
    if stop.exit_code:
        return _print_error(
            f"{stop.word}; {counted(summary.frames, 'frame')} saved", stop.exit_code
        )
    if exit_code == errors.DONE:
        warnings = [*summary.notes]
        if summary.skip_reason:
            warnings.append(f"frames were skipped, the first because {summary.skip_reason}")
        if summary.first_warning:
            warnings.append(
                f"{counted(summary.warning_count, 'warning')} on detections and targets, first: "
                f"{summary.first_warning} (frames counted from 0)"
            )
        for each in filter(None, [*warnings, warning]):
            print(f"track: {each}", file=sys.stderr)
        print(f"{options.source}: {summary.text}; results in {options.output}")
        if summary.keyframes.given:
            print(summary.keyframes.text)
    return exit_code


def _print_error(message: Any, exit_code: int) -> int:
    print_error("track", message)
    return exit_code


@dataclass
class _Stop:
    """The exit code of a received signal, and whether the first one interrupts at once."""

    exit_code: int = 0
    at_once: bool = False

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Stop after the current frame on the first signal, at once on the second."""
        is_second = bool(self.exit_code)
        self.exit_code = _SIGNALS[signal.Signals(number)]
        if is_second or self.at_once:
            raise KeyboardInterrupt

    @property
    def word(self) -> str:
        """The reason, for messages."""
        return "terminated" if self.exit_code == errors.TERMINATED else "interrupted"


@contextmanager
def _escaping_output() -> Iterator[None]:
    """Escape file names that are not valid UTF-8 on standard output, as on standard error."""
    output = sys.stdout
    if not isinstance(output, io.TextIOWrapper) or output.errors != "strict":
        yield
        return
    output.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        output.reconfigure(errors="strict")


if __name__ == "__main__":
    sys.exit(main())
