"""The command `evaluate`: scores of a preset on sequences with ground truth."""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Sequence
from contextlib import closing
from typing import Any

from pf_tracker_ros.command_lines import print_error
from pf_tracker_ros.evaluation.command_line import (
    INCOMPLETE,
    REFUSED,
    SUCCESS,
    checked_parameters,
    parser,
    require_packages,
    run_command,
)
from pf_tracker_ros.evaluation.one_pass import TrackerFactory, evaluate_each
from pf_tracker_ros.evaluation.output_files import ResultFiles
from pf_tracker_ros.evaluation.reports.evaluation_report import EvaluationReport
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure, SequenceResult
from pf_tracker_ros.evaluation.sequences import (
    frame_count,
    open_labeled_sequences,
    open_sequences,
)
from pf_tracker_ros.evaluation.summary import print_table
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.targets.tracker import Tracker
from pf_tracker_ros.tracking.presets import ActivePreset

NO_READER = 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without program name; None for this process'.

    Returns:
        Exit code, see `evaluate --help`; for any but 0 and 141, standard error has the reason.
    """
    return run_command("evaluate", lambda: _run(parser().parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    # All checks come before the first frame.
    has_report, has_plot = options.report is not None, options.plot is not None
    require_packages(
        "evaluation",
        "rich",
        *(["yaml"] if options.params_file is not None else []),
        *(["matplotlib"] if has_plot or has_report else []),
        *(["jinja2"] if has_report else []),
    )
    if options.compare and not has_report:
        raise EvaluationError("--compare needs --report DIR")
    report = EvaluationReport(options.report, options.compare) if has_report else None
    parameters, values = checked_parameters(options)
    make_tracker = functools.partial(Tracker.from_preset, options.preset, parameters=parameters)
    summary = ActivePreset.of({"preset": options.preset, **values}).summary
    outputs = ResultFiles(options.output, options.plot, options.preset, parameters, summary)
    sequences, unopened = (
        open_labeled_sequences(options.sequences, options.ground_truth)
        if options.ground_truth is not None
        else open_sequences(options.sequences)
    )
    if not sequences:
        for failure in unopened:
            _complain(failure.error)
        return REFUSED
    results = _evaluate(options, sequences, make_tracker, outputs)
    for failure in unopened:
        _complain(f"{failure.error}; the figures are without this sequence")
    if not results:
        _complain("no sequence could be evaluated")
        return INCOMPLETE
    evaluated = [(sequences[number], results[number]) for number in sorted(results)]
    report_error = report.write(summary, parameters, evaluated) if report else None
    if report_error is not None:
        _complain(report_error)
    all_evaluated = not unopened and len(results) == len(sequences)
    is_complete = all_evaluated and outputs.are_written and report_error is None
    runs = "1 seed" if options.seeds == 1 else f"mean of {options.seeds} seeds"
    try:
        print_table(f"preset {summary}; {runs}", _in_order(results))
    except BrokenPipeError:
        return NO_READER if is_complete else INCOMPLETE
    except OSError as error:
        _complain(f"the table cannot be printed ({error.strerror})")
        return INCOMPLETE
    return SUCCESS if is_complete else INCOMPLETE


def _evaluate(
    options: argparse.Namespace,
    sequences: Sequence[Footage],
    make_tracker: TrackerFactory,
    outputs: ResultFiles,
) -> dict[int, SequenceResult]:
    """Results by the index of their sequences; the outputs are written after each of them."""
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
    return results


def _in_order(results: dict[int, SequenceResult]) -> list[SequenceResult]:
    return [results[number] for number in sorted(results)]


def _complain(message: Any) -> None:
    print_error("evaluate", message)


if __name__ == "__main__":
    sys.exit(main())
