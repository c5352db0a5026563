"""The command line of `evaluate`, and what other commands share with it."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from pf_tracker_ros.command_lines import Parser, missing_package, print_error
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.parameter_files import TrackerSettings, read_parameter_file
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations
from pf_tracker_ros.signals import handled_signals
from pf_tracker_ros.targets.tracker import Tracker
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS

SUCCESS, INCOMPLETE, REFUSED, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
"""Exit codes of `evaluate` and `tune`."""

_PRESET = "default"
_DESCRIPTION = """\
Evaluate a preset of the tracker on sequences with ground truth: one pass from the first true box,
no restarts. Prints three scores, averaged over the seeds:

- the success AUC. For each overlap threshold 0, 0.05, ... 1, take the share of frames above it. The
  success AUC is the mean of these shares, at most 20/21.
- the share of frames with a center error of at most 20 px.
- the median CPU time of one update.
"""

_EXIT_CODES = """\
The files of --output and --plot are rewritten after every sequence.

exit codes:
  0    success
  1    a sequence could not be evaluated (the others were), or results could not be written; see
       standard error
  2    invalid request; nothing was evaluated
  130  interrupted (Ctrl-C)
  141  standard output was closed
  143  terminated
"""


class Termination(BaseException):
    """SIGTERM was received."""


def run_command(
    command: str, run: Callable[[], int], refusals: tuple[type[Exception], ...] = ()
) -> int:
    """Run a command; errors and signals that it does not handle itself are told in one line.

    Args:
        command: Its name.
        run: Runs it, and returns the exit code.
        refusals: Further exceptions of an invalid request; `exit_code` of one is the exit code.

    Returns:
        The exit code.
    """
    refusals = (EvaluationError, FootageError, ParameterError, OSError, *refusals)
    try:
        with handled_signals({signal.SIGTERM: _terminate}):
            return run()
    except refusals as error:
        print_error(command, error)
        return int(getattr(error, "exit_code", REFUSED))
    except KeyboardInterrupt:
        print(f"{command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Termination:
        print(f"{command}: terminated", file=sys.stderr)
        return TERMINATED


def _terminate(number: int, frame: FrameType | None) -> None:
    """Raise an exception, so that everything is cleaned up as after Ctrl-C."""
    raise Termination


def require_packages(extra: str, *packages: str) -> None:
    """Check that packages of an extra are installed.

    Raises:
        EvaluationError: One is not.
    """
    for package in packages:
        if missing := missing_package(package, extra):
            raise EvaluationError(missing)


def checked_parameters(options: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """The parameters of the options of `add_tracker_options`, whose preset is completed in place.

    Returns:
        Full name to value of those given in the options or the parameter file, and of all.

    Raises:
        ParameterError: A parameter is invalid.
        EvaluationError: As for `merge_parameter_file`.
    """
    merge_parameter_file(options)
    given = parse_parameters(options.parameter)
    with errors_name_parameter_file(options):
        values = Tracker.from_preset(options.preset, 0, given).parameters
    return given, dict(values)


def parse_parameters(
    assignments: Sequence[str],
    option: str = "--parameter",
    declared_in: type = TrackerParameters,
) -> dict[str, Any]:
    """Parse parameter assignments `NAME=VALUE` by the declared types.

    Lists are separated by commas, square brackets are optional. Unknown names and values that do
    not fit are passed on as strings, to be refused where the parameters are used.

    Args:
        assignments: The texts.
        option: Name of the option, for error messages.
        declared_in: Group of the parameters, as for `declarations`.

    Returns:
        Full parameter name to value.

    Raises:
        EvaluationError: A text has no `=`, or a name is given twice.
    """
    known = declarations(declared_in)
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
        element = float if declaration.type == tuple[float, ...] else _unquoted
        parts = text.removeprefix("[").removesuffix("]").strip()
        return tuple(element(part.strip()) for part in parts.split(",")) if parts else ()
    except ValueError:
        return text


def _unquoted(text: str) -> str:
    """A string without the quotes of a YAML list."""
    is_quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return text[1:-1] if is_quoted else text


def add_tracker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the tracker's preset and parameters."""
    parser.add_argument("--preset", help=f"{', '.join(PRESETS)} (default: {_PRESET})")
    parser.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set a parameter of the preset; may be repeated",
    )
    parser.add_argument(
        "--params-file",
        type=Path,
        metavar="FILE",
        help="ROS parameter file, such as one saved by the console; --parameter takes precedence",
    )


def merge_parameter_file(options: argparse.Namespace) -> TrackerSettings:
    """Merge the file of `--params-file` into the options `--preset` and `--parameter`.

    Args:
        options: Options of `add_tracker_options`, changed in place. The new attribute `from_file`
            has the names of the parameters from the file.

    Returns:
        The settings in the file; defaults without a file.

    Raises:
        ParameterError: The file cannot be read, or has no tracker parameters.
        EvaluationError: A text has no `=`, or the preset is given twice.
    """
    settings = TrackerSettings()
    options.from_file = ()
    if options.params_file is not None:
        settings = read_parameter_file(options.params_file)
        if settings.other_node:
            print(
                f"{options.params_file} is for the node {settings.other_node}, and is used for the "
                "tracker here; a node reads it only under that name",
                file=sys.stderr,
            )
        if options.preset and settings.preset:
            raise EvaluationError(
                f"--preset {options.preset} and {options.params_file} (preset {settings.preset}) "
                "both set the preset; remove one of them"
            )
        # Only the names are used.
        from_command_line = parse_parameters(options.parameter)
        options.from_file = tuple(
            name for name in settings.parameters if name not in from_command_line
        )
        options.parameter = [
            *(
                f"{name}={_as_typed(options.params_file, name, settings.parameters[name])}"
                for name in options.from_file
            ),
            *options.parameter,
        ]
    options.preset = options.preset or settings.preset or _PRESET
    return settings


@contextmanager
def errors_name_parameter_file(options: argparse.Namespace) -> Iterator[None]:
    """Prefix errors about parameters from the parameter file with its name.

    Args:
        options: As changed by `merge_parameter_file`.

    Raises:
        ParameterError: As in the block.
    """
    try:
        yield
    except ParameterError as error:
        if any(f"'{name}'" in str(error) for name in options.from_file):
            raise ParameterError(f"{options.params_file}: {error}") from None
        raise


def _as_typed(path: Path, name: str, value: Any) -> str:
    """A value of a parameter file as text for `parse_parameters`."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, tuple):
        return str(value)
    if any("," in str(element) for element in value):
        raise ParameterError(
            f"{path}: parameter '{name}' is {list(value)}; allowed here: strings without commas"
        )
    return ",".join(map(str, value))


def parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = Parser("evaluate", description=_DESCRIPTION, epilog=_EXIT_CODES)
    parser.add_argument(
        "sequences",
        nargs="+",
        metavar="SEQUENCE_DIR",
        help="sequence folder (groundtruth.txt or groundtruth_rect.txt, and frames), or folder of "
        "such folders",
    )
    add_tracker_options(parser)
    parser.add_argument(
        "--ground-truth",
        type=Path,
        metavar="FILE",
        help="true boxes for the only SEQUENCE_DIR, which may be a video or a folder of images "
        "then; FILE is MOT challenge text, COCO JSON, CVAT for video 1.1, KITTI tracking or the "
        "boxes.csv of track, and each target in it is evaluated by itself",
    )
    parser.add_argument(
        "--seeds",
        type=positive,
        default=3,
        metavar="N",
        help="average over the seeds 0 .. N-1 (default: %(default)s)",
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        default=1,
        metavar="N",
        help="processes (default: %(default)s); CPU times are comparable only with one, as several "
        "compete for caches and memory",
    )
    parser.add_argument("--output", type=Path, metavar="FILE.json", help="write the results")
    parser.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write DIR/report.html with plots and images of every sequence (needs Matplotlib and "
        "Jinja2)",
    )
    parser.add_argument(
        "--compare",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.json",
        help="results of another run to compare with in the report; may be repeated",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the success plot")
    return parser


def positive(text: str) -> int:
    """Type of an option: a whole number from 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 1")
    return int(text)


def seed(text: str) -> int:
    """Type of an option: a seed."""
    if not text.isdecimal() or int(text) >= 2**31:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 0 to 2147483647")
    return int(text)
