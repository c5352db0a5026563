"""The command `evaluate`: a preset's scores on sequences with ground truth."""

from __future__ import annotations

import argparse
import functools
import importlib
import signal
import sys
from collections.abc import Sequence
from contextlib import closing
from types import FrameType
from typing import Any

from pf_tracker_ros.evaluation.batch import evaluate_each
from pf_tracker_ros.evaluation.command_line import (
    errors_name_parameter_file,
    merge_parameter_file,
    parse_parameters,
    parser,
)
from pf_tracker_ros.evaluation.reports.evaluation_report import EvaluationReport
from pf_tracker_ros.evaluation.result_files import ResultFiles
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure, SequenceResult
from pf_tracker_ros.evaluation.sequences import frame_count, open_sequences
from pf_tracker_ros.evaluation.summary import print_table
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.signals import handled_signals
from pf_tracker_ros.targets.tracker import Tracker
from pf_tracker_ros.tracking.presets import ActivePreset

SUCCESS, INCOMPLETE, REFUSED, INTERRUPTED, NO_READER, TERMINATED = 0, 1, 2, 130, 141, 143


class _Termination(BaseException):
    """The process was asked to end."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without the program's name; None takes this process'.

    Returns:
        Exit code, as `evaluate --help` lists them; for any but 0 and 141, lines on standard error
        say why.
    """
    try:
        with handled_signals({signal.SIGTERM: _terminate}):
            return _run(parser().parse_args(arguments))
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        _complain(error)
        return REFUSED
    except KeyboardInterrupt:
        print("evaluate: interrupted", file=sys.stderr)
        return INTERRUPTED
    except _Termination:
        print("evaluate: terminated", file=sys.stderr)
        return TERMINATED


def _run(options: argparse.Namespace) -> int:
    # What can be refused is refused before the first frame, not after an hour's work.
    is_reported = options.report is not None
    _require_packages(options)
    if options.compare and not is_reported:
        raise EvaluationError("--compare is for the report; allowed: with --report DIR")
    report = EvaluationReport(options.report, options.compare) if is_reported else None
    merge_parameter_file(options)
    parameters = parse_parameters(options.parameter)
    make_tracker = functools.partial(Tracker.from_preset, options.preset, parameters=parameters)
    with errors_name_parameter_file(options):
        values = make_tracker(0).parameters
    summary = ActivePreset.of({"preset": options.preset, **values}).summary
    outputs = ResultFiles(options.output, options.plot, options.preset, parameters, summary)
    sequences, unopened = open_sequences(options.sequences)
    if not sequences:
        for failure in unopened:
            _complain(failure.error)
        return REFUSED
    results: dict[int, SequenceResult] = {}
    with (
        progress_bar(frame_count(sequences)) as on_progress,
        closing(
            evaluate_each(sequences, make_tracker, range(options.seeds), options.jobs, on_progress)
        ) as done,
    ):
        for number, result in done:
            if isinstance(result, SequenceFailure):
                _complain(result.error)
                continue
            results[number] = result
            for problem in outputs.write(_in_order(results)):
                _complain(problem)
    for failure in unopened:
        _complain(f"{failure.error}; it is left out, and the figures are of the others")
    if not results:
        _complain("no sequence could be evaluated")
        return INCOMPLETE
    evaluated = [(sequences[number], results[number]) for number in sorted(results)]
    unreported = report.write(summary, parameters, evaluated) if report else None
    if unreported is not None:
        _complain(unreported)
    runs = "1 seed" if options.seeds == 1 else f"mean of {options.seeds} seeds"
    is_evaluated = not unopened and len(results) == len(sequences)
    is_complete = is_evaluated and outputs.are_written and unreported is None
    try:
        print_table(f"preset {summary}; {runs}", _in_order(results))
    except BrokenPipeError:
        return NO_READER if is_complete else INCOMPLETE
    except OSError as error:
        _complain(f"the table cannot be printed ({error.strerror})")
        return INCOMPLETE
    return SUCCESS if is_complete else INCOMPLETE


def _in_order(results: dict[int, SequenceResult]) -> list[SequenceResult]:
    return [results[number] for number in sorted(results)]


def _complain(what: Any) -> None:
    print(f"evaluate: error: {' '.join(str(what).split())}", file=sys.stderr)


def _require_packages(options: argparse.Namespace) -> None:
    for package, is_needed in (
        ("rich", True),
        ("yaml", options.params_file is not None),
        ("matplotlib", options.plot is not None or options.report is not None),
        ("jinja2", options.report is not None),
    ):
        try:
            if is_needed:
                importlib.import_module(package)
        except ImportError as error:
            raise EvaluationError(
                f"{package} is not installed: pip install {package}, or '.[evaluation]' in the "
                "sources"
            ) from error


def _terminate(number: int, frame: FrameType | None) -> None:
    """End what is being done as Ctrl-C does, with all that is cleaned up then."""
    raise _Termination


if __name__ == "__main__":
    sys.exit(main())
