"""Argument parser of all executables; imports only light modules."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """Argument parser with one-line errors and unwrapped description and epilog.

    Args:
        prog: Name of the program.
        **further: As for `argparse.ArgumentParser`.
    """

    def __init__(self, prog: str, **further: Any) -> None:
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(prog=prog, formatter_class=formatter, **further)

    def error(self, message: str) -> NoReturn:
        """Print the error and end the program with exit code 2."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")
