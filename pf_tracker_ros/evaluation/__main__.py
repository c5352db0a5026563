"""The command `evaluate`: a preset's scores on sequences with ground truth."""

from __future__ import annotations

import argparse
import functools
import importlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from pf_tracker_ros.evaluation.plots import check_plot_format, save_success_plot
from pf_tracker_ros.evaluation.progress import frame_count, progress_bar
from pf_tracker_ros.evaluation.report import print_table, result_document
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceResult
from pf_tracker_ros.evaluation.runner import evaluate_sequences
from pf_tracker_ros.evaluation.sequences import read_sequences
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS
from pf_tracker_ros.tracking.tracker import Tracker

_DESCRIPTION = """\
Evaluate a preset of the tracker on sequences with ground truth: one pass from the first true box,
no restarts. Prints the success AUC (mean over the overlap thresholds 0, .05, .. 1 of the share of
frames with an overlap above it; 20/21 is perfect), the share of frames with a center error of at
most 20 px, and the median CPU time of one update, averaged over the seeds.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Command line without the program's name; None takes this process'.

    Returns:
        Exit code: 0 if all went well, 2 for a request that cannot be carried out, after one line on
        standard error that says why, 130 after Ctrl-C.
    """
    try:
        _run(_parser().parse_args(arguments))
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        print(f"evaluate: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("evaluate: interrupted", file=sys.stderr)
        return 130
    return 0


def _run(options: argparse.Namespace) -> None:
    # What can be refused is refused before the first frame, not after an hour's work.
    _require("rich")
    if options.output is not None:
        _check_writable(options.output)
    if options.plot is not None:
        _require("matplotlib")
        _check_writable(options.plot)
        check_plot_format(options.plot)
    parameters = parse_parameters(options.parameter)
    make_tracker = functools.partial(Tracker.from_preset, options.preset, parameters=parameters)
    make_tracker(0)
    sequences = read_sequences(options.sequences)
    with progress_bar(frame_count(sequences)) as on_progress:
        results = evaluate_sequences(
            sequences, make_tracker, range(options.seeds), options.jobs, on_progress
        )
    runs = "1 seed" if options.seeds == 1 else f"mean of {options.seeds} seeds"
    print_table(f"preset {options.preset}, {runs}", results)
    if options.output is not None:
        document = result_document(options.preset, parameters, results)
        text = json.dumps(document, indent=2, allow_nan=False) + "\n"
        options.output.write_text(text, encoding="utf-8")
    if options.plot is not None:
        _plot(options.plot, options.preset, results)


def parse_parameters(assignments: Sequence[str], option: str = "--parameter") -> dict[str, Any]:
    """Values of parameters from texts `NAME=VALUE`, read by the type that is declared.

    A list is written with commas, with or without square brackets. Whether a name exists and a
    value is allowed is for the tracker to judge, which names what would be.

    Args:
        assignments: The texts.
        option: Where they were given, for the message of an error.

    Returns:
        Full parameter name to value; a text that does not fit the type is kept as a string.

    Raises:
        EvaluationError: A text has no `=`, or a name is given twice.
    """
    known = declarations(TrackerParameters)
    values: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals or not name:
            raise EvaluationError(f"{option} {assignment!r}; allowed: NAME=VALUE")
        if name in values:
            raise EvaluationError(f"{option} {name} is given more than once")
        values[name] = _parse_value(known[name], text) if name in known else text
    return values


def _parse_value(declaration: Declaration, text: str) -> Any:
    if declaration.type is bool:
        return {"true": True, "false": False}.get(text.lower(), text)
    if declaration.type is str:
        return text
    try:
        if declaration.type in (int, float):
            return declaration.type(text)
        return tuple(float(part) for part in text.removeprefix("[").removesuffix("]").split(","))
    except ValueError:
        return text


class _Parser(argparse.ArgumentParser):
    """An argument parser that refuses in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"evaluate: error: {message} (evaluate --help tells more)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="evaluate", description=_DESCRIPTION)
    parser.add_argument(
        "sequences",
        nargs="+",
        metavar="SEQUENCE_DIR",
        help="a sequence folder (groundtruth.txt and frames), or a folder of such folders",
    )
    parser.add_argument(
        "--preset", default="default", help=f"{', '.join(PRESETS)} (default: %(default)s)"
    )
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="another value than the preset's for a parameter; may be repeated",
    )
    parser.add_argument(
        "--seeds",
        type=_positive,
        default=3,
        metavar="N",
        help="average over the seeds 0 .. N-1 (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs",
        type=_positive,
        default=1,
        metavar="N",
        help="processes (default: %(default)s); CPU times are honest with one only, "
        "as several compete for caches and memory",
    )
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="write the results here")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the success plot here")
    return parser


def _positive(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 1")
    return value


def _require(package: str) -> None:
    try:
        importlib.import_module(package)
    except ImportError as error:
        raise EvaluationError(
            f"{package} is not installed: pip install {package}, or '.[evaluation]' in the sources"
        ) from error


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise EvaluationError(f"{path} is a folder; allowed: a file to write")
    if not path.parent.is_dir():
        raise EvaluationError(f"no folder {path.parent} to write {path.name} into")


def _plot(path: Path, preset: str, results: Sequence[SequenceResult]) -> None:
    curves = {result.name: result.success_curve for result in results}
    save_success_plot(path, {preset: np.mean(list(curves.values()), axis=0)}, details=curves)


if __name__ == "__main__":
    sys.exit(main())
