"""What the command lines of all executables share; imports nothing that takes time."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """An argument parser that refuses in one line, and keeps the lines of its help as they are.

    Args:
        prog: Name of the program.
        **further: As for `argparse.ArgumentParser`.
    """

    def __init__(self, prog: str, **further: Any) -> None:
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(prog=prog, formatter_class=formatter, **further)

    def error(self, message: str) -> NoReturn:
        """Tell what is wrong with the command line, and end the program."""
        self.exit(2, f"{self.prog}: error: {message} ({self.prog} --help tells more)\n")
