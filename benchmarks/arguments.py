"""The part of the command line that comparisons on sequences share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def parser(description: str | None) -> argparse.ArgumentParser:
    """A parser of sequence folders, `--seeds` and `--output`."""
    made = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument(
        "sequences",
        nargs="+",
        type=Path,
        metavar="SEQUENCE_DIR",
        help="a sequence folder (groundtruth.txt and frames), or a folder of such folders",
    )
    made.add_argument(
        "--seeds", type=at_least(1), default=3, metavar="N", help="the seeds 0 .. N-1 [3]"
    )
    made.add_argument(
        "--output",
        type=Path,
        default=Path("benchmarks/results"),
        metavar="DIR",
        help="folder for the files [benchmarks/results]",
    )
    return made


def at_least(least: int) -> Callable[[str], int]:
    """What reads a whole number from `least` up."""

    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(
                f"'{text}'; allowed: a whole number of at least {least}"
            )
        return int(text)

    return whole
