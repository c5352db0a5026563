"""Code of other packages, which may raise anything, also what ends a process."""

from __future__ import annotations

import argparse
import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pf_tracker_ros.signals import handled_signals

# Characters of a reason.
_LONGEST_REASON = 500


class ForeignError(Exception):
    """Code of another package failed; the message is its error in one line of limited length."""


@contextmanager
def foreign_code() -> Iterator[None]:
    """Run code of another package within a block.

    Raises:
        ForeignError: It raised anything, also SystemExit or KeyboardInterrupt.
        KeyboardInterrupt: The user pressed Ctrl-C meanwhile.
    """
    interrupts: list[int] = []

    def on_interrupt(number: int, frame: Any) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    try:
        with handled_signals({signal.SIGINT: on_interrupt} if is_default else {}):
            yield
    except BaseException as error:
        if interrupts:
            raise
        raise ForeignError(_reason(error)) from error


def foreign_exit(ended: SystemExit) -> str:
    """Where another package has ended the process; empty if it is an end of this package's own."""
    place = traceback.extract_tb(ended.__traceback__)[-1]
    file, package = Path(place.filename).resolve(), Path(__file__).resolve().parent
    if file == Path(argparse.__file__).resolve() or file.is_relative_to(package):
        return ""
    return f"{place.filename}, line {place.lineno}, has ended the process ({_reason(ended)})"


def _reason(error: BaseException) -> str:
    try:
        text = " ".join(f"{type(error).__name__}: {error}".split())
    except Exception:
        text = type(error).__name__
    return text if len(text) <= _LONGEST_REASON else f"{text[:_LONGEST_REASON]}..."
