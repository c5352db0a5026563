"""The command `tune`: values of a preset's parameters for one's own footage."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from pf_tracker_ros.command_lines import Parser, print_error
from pf_tracker_ros.evaluation.command_line import (
    INCOMPLETE,
    INTERRUPTED,
    SUCCESS,
    TERMINATED,
    Termination,
    add_tracker_options,
    checked_parameters,
    positive,
    require_packages,
    run_command,
    seed,
)
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.evaluation.sequences import open_sequences
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.recordings.archives.executors import Executor, make_executor
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.tuning.search_space import search_space

_DESCRIPTION = """\
Tune a preset on sequences with ground truth, and write a ROS parameter file with the values that
differ from it. Optuna searches the largest mean success AUC, see `evaluate --help`. The search is
repeated without each group of sequences, and its values are tested on them. If the gain on these
sequences left out is not above 0 in its 95 % interval, the file has the preset's values.

Parameters of --parameter or --params-file that are tuned are values to start from; others are kept.

With --confidence, no values are searched. The probability that the box is on the target is fitted
to the sequences, and tested in the same way.
"""

_EPILOG = """\
examples:
  tune sequences --trials 100 --jobs 4 --output mine.yaml
  tracker --ros-args --params-file mine.yaml
  tune sequences --confidence --params-file mine.yaml --output calibrated.yaml

Beside mine.yaml are mine.html, a report, and mine.journal, all trials. The same command continues
an interrupted run from the journal; with more trials, it extends a finished one.

exit codes:
  0    success, also if nothing is better than the preset
  1    a sequence or a trial could not be evaluated (the others were), or an output could not be
       written; see standard error
  2    invalid request; nothing was evaluated
  130  interrupted (Ctrl-C); the file has the best values so far
  143  terminated; likewise
"""


DEFAULT_TRIALS = 100
"""Trials without --trials."""


def parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = Parser("tune", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument(
        "sequences",
        nargs="+",
        metavar="SEQUENCE_DIR",
        help="sequence folder (groundtruth.txt or groundtruth_rect.txt, and frames), or folder of "
        "such folders; at least 2 sequences",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FILE.yaml",
        help="ROS parameter file to write",
    )
    add_tracker_options(parser)
    parser.add_argument(
        "--confidence",
        action="store_true",
        help="fit track.confidence_calibration, which makes the reported confidence the "
        "probability that the box is on the target, instead of searching values",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="tune only this parameter; may be repeated (default: all with a measured effect)",
    )
    parser.add_argument(
        "--trials",
        type=positive,
        metavar="N",
        help=f"trials of each search (default: {DEFAULT_TRIALS})",
    )
    parser.add_argument(
        "--seeds",
        type=positive,
        default=2,
        metavar="N",
        help="seeds of the tracker in each trial (default: %(default)s)",
    )
    parser.add_argument(
        "--folds",
        type=_folds,
        default=4,
        metavar="N",
        help="groups of sequences that are left out in turn, in the order given; at most one for "
        "each sequence (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=seed,
        default=0,
        metavar="N",
        help="seed of the search; the same seed gives the same result (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        metavar="N",
        help="parallel evaluations (default: 1; with --ray: one per core)",
    )
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="distribute the evaluations over a Ray cluster: auto or HOST:PORT of a running "
        "cluster, whose machines have the sequences at the same paths, or local to start one on "
        "this machine (needs ray)",
    )
    return parser


def _folds(text: str) -> int:
    if not text.isdecimal() or int(text) < 2:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 2")
    return int(text)


# Memory that Ray reserves for an evaluation, bytes: enough for images of 8 megapixels.
_TASK_MEMORY = 500 * 10**6
_PACKAGES = ("optuna", "scipy", "rich", "jinja2", "yaml")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without program name; None for this process'.

    Returns:
        Exit code, see `tune --help`; for any but 0, standard error has the reason.
    """
    return run_command("tune", lambda: _run(parser().parse_args(arguments)), (RecordingError,))


def _run(options: argparse.Namespace) -> int:
    # All checks come before the first frame.
    require_packages("tune", *_PACKAGES, *(["matplotlib"] if options.confidence else []))
    from pf_tracker_ros.tuning.journal import open_journal

    make_run, outputs_of = _kind_of_run(options)
    sequences, unopened = open_sequences(options.sequences)
    for failure in unopened:
        _complain(failure.error)
    if len(sequences) < 2:
        raise EvaluationError(
            f"{len(sequences) or 'no'} sequence{'' if len(sequences) == 1 else 's'} to tune on; "
            "allowed: at least 2, as whole sequences are left out to test the values"
        )
    output: Path = options.output
    journal = _checked_journal(output)
    outputs = outputs_of(output)
    with open_journal(journal) as storage, _executor(options) as executor:
        run = make_run(sequences, storage, executor)
        finished = run.finished if output.exists() else {}
        _refuse_less(options, finished)
        try:
            with progress_bar(run.runs, "runs") as on_progress:
                result = run.run(on_progress)
        except (KeyboardInterrupt, Termination, OSError) as stop:
            kept = (
                f"{output} keeps its finished result"
                if finished
                else outputs.write_interrupted(run)
            )
            reason, code = _stopped(stop)
            print(f"tune: {reason}; {kept}", file=sys.stderr)
            return code
    for each in run.errors:
        _complain(f"{each}; the figures are without this evaluation")
    errors = outputs.write_result(result)
    for error in errors:
        _complain(error)
    print(*outputs.summary(result), sep="\n")
    print(f"{output} has the parameters, {outputs.page} the report")
    return INCOMPLETE if unopened or run.errors or errors else SUCCESS


def _kind_of_run(options: argparse.Namespace) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The constructors of the run and of its outputs, with the request of the options.

    Raises:
        EvaluationError: Options exclude each other.
        ParameterError: A parameter is not allowed.
    """
    from pf_tracker_ros.tuning.confidence_output import CalibrationFiles
    from pf_tracker_ros.tuning.confidence_run import PARAMETER, ConfidenceRequest, ConfidenceRun
    from pf_tracker_ros.tuning.output import TuningFiles
    from pf_tracker_ros.tuning.search import TuningRequest
    from pf_tracker_ros.tuning.tuning import Tuning

    given, values = checked_parameters(options)
    given = {name: values[name] for name in given}
    if options.confidence:
        if options.trials is not None or options.only:
            raise EvaluationError(
                "--confidence has no search; allowed: no --trials and no --only with it"
            )
        # It is fitted anew.
        given.pop(PARAMETER, None)
        fitted = ConfidenceRequest(options.preset, given, options.seeds, options.folds)
        return partial(ConfidenceRun, fitted), partial(CalibrationFiles, request=fitted)
    if options.trials is None:
        options.trials = DEFAULT_TRIALS
    request = TuningRequest(
        options.preset,
        given,
        search_space(options.preset, given, options.only),
        options.trials,
        options.seeds,
        options.folds,
        options.seed,
    )
    return partial(Tuning, request), partial(TuningFiles, request=request)


def _refuse_less(options: argparse.Namespace, finished: Mapping[str, int]) -> None:
    """Keep a finished result from one of fewer trials or groups.

    Raises:
        EvaluationError: The options ask for fewer.
    """
    for name, count in finished.items():
        asked = getattr(options, name)
        if asked < count:
            raise EvaluationError(
                f"{options.output} is the result of --{name} {count}, and --{name} {asked} would "
                f"replace it by one of fewer; allowed: {count} or more, or another --output"
            )


def _stopped(stop: BaseException) -> tuple[str, int]:
    """The reason of an incomplete run, and its exit code."""
    if isinstance(stop, KeyboardInterrupt):
        return "interrupted", INTERRUPTED
    if isinstance(stop, Termination):
        return "terminated", TERMINATED
    return f"error: {stop}", INCOMPLETE


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Executor | None]:
    """The executor of the options; None for this process."""
    if options.ray is None and options.jobs in (None, 1):
        yield None
        return
    with make_executor(options.ray, options.jobs, lambda task: _TASK_MEMORY) as executor:
        yield executor


def _checked_journal(output: Path) -> Path:
    """The journal of an output, which replaces no file but that of an earlier run.

    Raises:
        EvaluationError: The output exists, but not its journal, or has the wrong suffix.
    """
    if output.suffix not in (".yaml", ".yml"):
        raise EvaluationError(f"--output {output}; allowed: a file name that ends in .yaml")
    journal = output.with_suffix(".journal")
    for path in (output, output.with_suffix(".html")):
        if path.is_file() and not journal.exists():
            raise EvaluationError(
                f"{path} exists, and no {journal.name} beside it shows that tune wrote it; remove "
                "it, or choose another --output"
            )
    return journal


def _complain(message: Any) -> None:
    print_error("tune", message)


if __name__ == "__main__":
    sys.exit(main())
