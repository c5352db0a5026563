"""Command-line options shared by the benchmarks, which import it before NumPy.

Linear algebra then has one thread: NumPy reads the environment when it is imported.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from pf_tracker_ros.evaluation import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.parameters import ParameterError


def parser(description: str | None) -> argparse.ArgumentParser:
    """A parser that shows a module's docstring unwrapped."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def sequence_parser(description: str | None, seeds: int = 3) -> argparse.ArgumentParser:
    """A parser of sequence folders and `--seeds`."""
    made = parser(description)
    made.add_argument(
        "sequences",
        nargs="+",
        type=Path,
        metavar="SEQUENCE_DIR",
        help="sequence folder (groundtruth.txt and frames), or folder of such folders",
    )
    add_seeds(made, seeds)
    return made


def add_seeds(made: argparse.ArgumentParser, seeds: int, what: str = "the seeds 0 .. N-1") -> None:
    """Add `--seeds`."""
    made.add_argument(
        "--seeds", type=at_least(1), default=seeds, metavar="N", help=f"{what} [{seeds}]"
    )


def add_folder(made: argparse.ArgumentParser) -> None:
    """Add `--output` for a folder."""
    made.add_argument(
        "--output",
        type=Path,
        default=Path("benchmarks/results"),
        metavar="DIR",
        help="folder for the files [%(default)s]",
    )


@contextmanager
def told_errors(made: argparse.ArgumentParser) -> Iterator[None]:
    """Ends the program with one line for footage, files and parameters that cannot be used."""
    try:
        yield
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        made.error(" ".join(str(error).split()))


def at_least(least: int) -> Callable[[str], int]:
    """Type of an option: a whole number of at least `least`."""

    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(
                f"'{text}'; allowed: a whole number of at least {least}"
            )
        return int(text)

    return whole
