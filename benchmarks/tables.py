"""Tables of results, for a terminal and as Markdown."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

TABLES_FILE = "PF_TRACKER_TABLES"
"""Environment variable with a file that every table shown is appended to, for `figures.py`."""


@dataclass(frozen=True)
class Table:
    """A table of results; its cells are texts."""

    title: str  # its title
    headings: Sequence[str]  # a heading for each column
    rows: Sequence[Sequence[str]]  # the cells of each row
    names: int = 1  # number of columns with names, from the left; the others have figures

    def show(self) -> None:
        """Print on standard output, and append to the file that the environment names, if any."""
        print(f"\n{self.title}")
        cells = [self.headings, *self.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        for row in cells:
            print(*(cell.ljust(width) for cell, width in zip(row, widths, strict=True)), sep="  ")
        if path := os.environ.get(TABLES_FILE):
            with Path(path).open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(self)) + "\n")

    def markdown(self) -> list[str]:
        """Lines of Markdown without the title."""
        alignment = ["---"] * self.names + ["---:"] * (len(self.headings) - self.names)
        # A vertical bar would end the cell.
        return [
            "| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |"
            for row in (self.headings, alignment, *self.rows)
        ]


def bold(text: str, is_bold: bool = True) -> str:
    """A cell's text, optionally bold."""
    return f"**{text}**" if is_bold else text
