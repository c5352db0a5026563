"""The command `track`: targets through a recording, into files."""

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
from pf_tracker_ros.recordings.output_folder import OutputFolder
from pf_tracker_ros.recordings.plan import (
    SIDECAR,
    Plan,
    apply_parameter_file,
    check_applies,
    check_request,
    make_plan,
    open_from_options,
    require_package,
    uses_detector,
)
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, save_targets
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.signals import handled_signals

_SIGNALS = {signal.SIGINT: errors.INTERRUPTED, signal.SIGTERM: errors.TERMINATED}
# Why a frame that is not refused is not tracked.
_SKIPPED_FOR = {
    "duplicate": "its stamp is that of the frame before",
    "late": "its stamp is before that of the frame before",
}


@dataclass
class _Summary:
    """What is told at the end of the recording of a name."""

    name: str
    states: Counter[str] = field(default_factory=Counter)
    skipped: str = ""
    warning: str = ""
    warnings: int = 0
    ids: set[int] = field(default_factory=set)
    targets_of: str = ""
    several: bool = False
    announced: int | None = None
    seconds: float = 0.0

    def add(self, tracked: TrackedFrame) -> None:
        self.states[tracked.state] += 1
        self.skipped = self.skipped or tracked.problem or _SKIPPED_FOR.get(tracked.outcome, "")
        if tracked.warnings and not self.warning:
            self.warning = f"frame {tracked.frame.index}: {tracked.warnings[0]}"
        self.warnings += len(tracked.warnings)
        self.ids.update(target.id for target in tracked.targets)

    @property
    def frames(self) -> int:
        return self.states.total()

    @property
    def text(self) -> str:
        shares = ", ".join(
            f"{count / self.frames:.0%} {state}" for state, count in self.states.most_common()
        )
        rate = self.frames / self.seconds if self.seconds else 0.0
        if self.ids and self.several:
            shares = f"the best seen target: {shares}"
        targets = f", {counted(len(self.ids), 'target')}" if self.several else ""
        origin = f"; target of {self.targets_of}" if self.targets_of else ""
        return f"{counted(self.frames, 'frame')} ({shares}){targets}, {rate:.0f} frames/s{origin}"


def main(arguments: Sequence[str] | None = None, source_name: str | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without the program's name; None takes this process'.
        source_name: Of a recording of an archive what it is called, and where it is if that is a
            URL; None for one alone, whose path or URL is taken.

    Returns:
        Exit code, as `track --help` lists them; for any but 0, a line on standard error says why.
    """
    stop = _Stop()
    handlers = dict.fromkeys(_SIGNALS, stop.notice)
    try:
        with handled_signals(handlers), quiet_opencv(), _printing_any_name():
            return _run(parser().parse_args(arguments), stop, source_name)
    except FootageError as error:
        return _complain(error, errors.UNREADABLE_SOURCE)
    except RecordingError as error:
        return _complain(error, error.exit_code)
    except (EvaluationError, ParameterError) as error:
        return _complain(error, errors.REFUSED)
    except KeyboardInterrupt:
        return _complain(
            f"{stop.word} at once; what was not finished is gone",
            stop.exit_code or errors.INTERRUPTED,
        )


def _run(options: argparse.Namespace, stop: _Stop, source_name: str | None) -> int:
    # What can be refused is refused before the first frame, not after an hour's work.
    for package, extra, wanted in (
        ("rich", "recordings", True),
        ("yaml", "recordings", True),
        ("rosbags", "recordings", options.bag),
        ("pyarrow", "parquet", options.parquet),
        ("matplotlib", "recordings", options.report is not None),
        ("jinja2", "recordings", options.report is not None),
        ("aiohttp", "console", options.draw),
        ("scipy", "targets", uses_detector(options)),
    ):
        if wanted:
            require_package(package, extra)
    _check_kind(options)
    apply_parameter_file(options)
    check_request(options)
    if options.archive is not None:
        stop.at_once = True
        return run_archive(options)
    with local_copy(parse_path_or_url(options.source)) as path:
        name = source_name or options.source
        with errors_name_source(name, path):
            return _run_one(options, path, name, stop, is_archived=source_name is not None)


def _check_kind(options: argparse.Namespace) -> None:
    """Refuse what is for an archive without one."""
    if options.archive is not None:
        return
    for option in ("dry_run", "ray", "jobs"):
        if getattr(options, option):
            what = f"--{option.replace('_', '-')} is for an archive"
            raise RecordingError(f"{what}; give one with --archive FOLDER_OR_LIST")
    if not options.source:
        message = "there is no SOURCE; give one, or --archive FOLDER_OR_LIST"
        for option in ("detections", "report"):
            taken = getattr(options, option)
            if taken not in (None, SIDECAR):
                message += f"; {taken} was taken for --{option}: SOURCE comes first"
        raise RecordingError(message)
    if options.draw and options.box:
        raise RecordingError("--draw and --box both give the target; allowed: one of them")
    if is_url(options.output):
        raise RecordingError(f"--output {options.output} is for an archive; allowed: a folder")


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
    summary = _Summary(name, targets_of=_found_beside(options, plan), several=plan.max_targets > 1)
    failures: list[Exception] = []
    try:
        try:
            _track(plan.track(), plan.recording, outputs, summary, stop)
        except (FootageError, RecordingError) as error:
            # Without a target, and a detector that might find one, there is nothing to keep.
            is_idle = summary.states.keys() <= {"idle", "skipped"}
            if not summary.frames or (is_idle and not plan.detection_source):
                raise
            name_source_in(error, name, plan.recording.path)
            failures.append(error)
        for folder in outputs:
            failures += folder.close()
    except BaseException:
        for folder in outputs:
            folder.discard()
        raise
    warning = plan.detection_source.warning if plan.detection_source else ""
    if warning and not plan.targets:
        warning += ", --box gives a target without it"
    return _report(options, summary, stop, failures, warning)


def _found_beside(options: argparse.Namespace, plan: Plan) -> str:
    """Where targets come from that nobody has given on the command line, or empty."""
    if not plan.targets or options.box or options.draw:
        return ""
    from_truth = plan.targets[0].box is None
    return "the ground truth" if from_truth else target_file(plan.recording.path).name


def _draw(
    recording: Recording, options: argparse.Namespace, stop: _Stop, most: int
) -> tuple[Target, ...]:
    """Have the targets drawn on a page, and save them beside the recording where that can be."""
    from pf_tracker_ros.recordings.drawing.server import prompt_for_targets

    stop.at_once = True
    try:
        targets = prompt_for_targets(recording, most, _announce)
    except KeyboardInterrupt:
        raise RecordingError(
            f"{stop.word} before a target was drawn; nothing was tracked", stop.exit_code
        ) from None
    finally:
        stop.at_once = False
    if is_url(options.source):
        kept = f"not saved, as {options.source} is not a place on this machine"
    else:
        kept = _kept(targets, recording.path)
    drawn = "; ".join(
        f"{','.join(f'{value:.10g}' for value in target.box or ())} in frame {target.frame}"
        for target in targets
    )
    print(f"target{'s' if len(targets) > 1 else ''} {drawn}, {kept}", flush=True)
    return targets


def _announce(address: str) -> None:
    print(f"draw the targets at {address} (Ctrl-C gives it up)", flush=True)


def _kept(targets: Sequence[Target], source: Path) -> str:
    """What became of the file of a recording's targets."""
    try:
        return f"saved as {save_targets(targets, source)}"
    except FileExistsError:
        return f"not saved, as {target_file(source)} is there already: remove it to keep these"
    except OSError as error:
        return f"not saved, as {unwritable(target_file(source), error)}"


def _track(
    tracking: Generator[TrackedFrame, None, None],
    recording: Recording,
    outputs: Sequence[OutputFolder],
    summary: _Summary,
    stop: _Stop,
) -> None:
    began = time.monotonic()
    summary.announced = recording.frame_count
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
        summary.seconds = time.monotonic() - began


def _report(
    options: argparse.Namespace,
    summary: _Summary,
    stop: _Stop,
    failures: list[Exception],
    warning: str,
) -> int:
    """Say what came of it, and with which exit code.

    Args:
        options: Of the command line.
        summary: Of the frames.
        stop: Whether it was asked to end.
        failures: What went wrong.
        warning: On the detector, or empty.
    """
    code = errors.DONE
    # What cannot be written any further can as a rule not be finished either, and is told once.
    for failure in {str(failure): failure for failure in failures}.values():
        found = getattr(failure, "exit_code", errors.UNREADABLE_SOURCE)
        code = code or found
        verb = "was" if summary.frames == 1 else "were"
        kept = f"; {counted(summary.frames, 'frame')} {verb} tracked" if summary.frames else ""
        _complain(f"{failure}{kept}", found)
    if stop.exit_code:
        verb = "is" if summary.frames == 1 else "are"
        return _complain(
            f"{stop.word} after {counted(summary.frames, 'frame')}, which {verb} kept",
            stop.exit_code,
        )
    if code == errors.DONE:
        warnings = []
        if summary.announced is not None and summary.frames < summary.announced:
            warnings.append(
                f"{summary.name} announces {counted(summary.announced, 'frame')}, but only "
                f"{summary.frames} could be read: it is damaged or cut off"
            )
        if summary.skipped:
            warnings.append(f"frames were skipped, the first because {summary.skipped}")
        if summary.warning:
            warnings.append(
                f"of {counted(summary.warnings, 'warning')} on detections and targets the first is: "
                f"{summary.warning} (frames count from 0)"
            )
        for each in filter(None, [*warnings, warning]):
            print(f"track: {each}", file=sys.stderr)
        print(f"{options.source}: {summary.text}; results in {options.output}")
    return code


def _complain(what: Any, exit_code: int) -> int:
    print(f"track: error: {' '.join(str(what).split())}", file=sys.stderr)
    return exit_code


@dataclass
class _Stop:
    """Whether the work shall end, with which exit code, and whether before the frame is done."""

    exit_code: int = 0
    at_once: bool = False

    def notice(self, number: int, frame: FrameType | None) -> None:
        """Take a signal: the first one ends the work after a frame, the second one at once."""
        is_second = bool(self.exit_code)
        self.exit_code = _SIGNALS[signal.Signals(number)]
        if is_second or self.at_once:
            raise KeyboardInterrupt

    @property
    def word(self) -> str:
        """Why."""
        return "terminated" if self.exit_code == errors.TERMINATED else "interrupted"


@contextmanager
def _printing_any_name() -> Iterator[None]:
    """Print names of files that are no text as standard error does, in place of failing."""
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
