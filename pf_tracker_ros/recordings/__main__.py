"""The command `track`: tracks targets through a recording and writes the results to files."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from pf_tracker_ros.command_lines import print_error
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.cameras import camera_name, is_camera
from pf_tracker_ros.opencv import quiet_opencv
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.recordings import errors
from pf_tracker_ros.recordings.archives.command import run_archive
from pf_tracker_ros.recordings.archives.sources import errors_name_source, local_copy
from pf_tracker_ros.recordings.archives.stores import is_url, parse_path_or_url
from pf_tracker_ros.recordings.command_line import parser
from pf_tracker_ros.recordings.errors import RecordingError, unwritable
from pf_tracker_ros.recordings.output_files import output_files, report_folder
from pf_tracker_ros.recordings.plan import SIDECAR, apply_parameter_file, check_request
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.run import RunSummary, Stop, check_packages, run_recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, save_targets


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without the program's name; None means that of this process.

    Returns:
        Exit code as listed by `track --help`. A line on standard error explains any but 0.
    """
    stop = Stop()
    try:
        with stop.handled(), quiet_opencv(), _escaping_output():
            return _run(parser().parse_args(arguments), stop)
    except FootageError as error:
        return _print_error(error, errors.UNREADABLE_SOURCE)
    except RecordingError as error:
        return _print_error(error, error.exit_code)
    except (EvaluationError, ParameterError) as error:
        return _print_error(error, errors.REFUSED)
    except KeyboardInterrupt:
        exit_code = stop.exit_code or errors.INTERRUPTED
        return _print_error(f"{stop.word}; unfinished files were discarded", exit_code)


def _run(options: argparse.Namespace, stop: Stop) -> int:
    # Errors of the request are reported before the first frame, not after an hour of tracking.
    check_packages(options)
    _check_options(options)
    apply_parameter_file(options)
    check_request(options)
    if options.archive is not None:
        stop.at_once = True
        return run_archive(options)
    page = _Page(options, stop) if options.draw else None
    with closing(page) if page else nullcontext(), _opened(options) as path:
        summary = run_recording(options, path, options.source, stop, page)
        _print_summary(options, summary)
        if page:
            page.finish(summary)
    return summary.exit_code


@contextmanager
def _opened(options: argparse.Namespace) -> Iterator[Path | str]:
    """The path of the source, or of its local copy, or the camera; errors name the source."""
    if is_camera(options.source):
        camera, options.source = options.source, camera_name(options.source)
        print(f"opening {options.source}; Ctrl-C ends it and writes the results", flush=True)
        yield camera
        return
    with (
        local_copy(parse_path_or_url(options.source)) as path,
        errors_name_source(options.source, path),
    ):
        yield path


def _print_summary(options: argparse.Namespace, summary: RunSummary) -> None:
    for error in summary.errors:
        print_error("track", error)
    for warning in summary.warnings:
        print(f"track: {warning}", file=sys.stderr)
    if not summary.errors:
        first, *others = summary.lines
        place = options.output
        if options.report is not None:
            place = f"{place}, report {report_folder(options) / REPORT_FILE}"
        lines = (f"{options.source}: {first}; results in {place}", *others)
        print(*lines, sep="\n", flush=True)


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


class _Page:
    """The page of --draw, from the first box to the report.

    Args:
        options: Of the command line.
        stop: Ends it.
    """

    def __init__(self, options: argparse.Namespace, stop: Stop) -> None:
        from pf_tracker_ros.recordings.drawing.server import TargetPage

        self._options = options
        self._stop = stop
        self._page = TargetPage(_print_url)
        self.show = self._page.show
        self.close = self._page.close

    def ask(self, recording: Recording, max_targets: int) -> tuple[Target, ...]:
        """Let the user draw the targets, and save them beside the recording if possible."""
        try:
            with self._stop.interrupting():
                targets = self._page.ask(recording, max_targets)
        except KeyboardInterrupt:
            raise RecordingError(
                f"{self._stop.word} before a target was drawn; nothing was tracked",
                self._stop.exit_code,
            ) from None
        if recording.is_live:
            saved = "not saved, because a camera sees it only now"
        elif is_url(self._options.source):
            saved = "not saved, because the recording has a URL"
        else:
            saved = _save(targets, recording.path)
        boxes = "; ".join(
            f"{','.join(f'{value:.10g}' for value in target.box or ())} in frame {target.frame}"
            for target in targets
        )
        print(f"target{'s' if len(targets) > 1 else ''} {boxes}, {saved}", flush=True)
        return targets

    def finish(self, summary: RunSummary) -> None:
        """Show the report until the page is closed or a signal ends it."""
        from pf_tracker_ros.recordings.drawing.progress import WrittenFiles

        files = [
            folder / name
            for folder, names in output_files(self._options).items()
            for name in names
            if (folder / name).is_file()
        ]
        reports = [path for path in files if path.name == REPORT_FILE]
        report = reports[0] if reports and not summary.errors else None
        text = "; ".join([*summary.errors, *summary.warnings, *summary.lines])
        if report:
            print("the page shows the report; close it, or press Ctrl-C, to end", flush=True)
        # A camera was ended by a signal: only another one ends the page.
        self._stop.exit_code = 0
        with contextlib.suppress(KeyboardInterrupt), self._stop.interrupting():
            self._page.finish(text, WrittenFiles(files, report))


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


def _print_error(message: Any, exit_code: int) -> int:
    print_error("track", message)
    return exit_code


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
