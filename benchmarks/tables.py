"""Tables of results, for a terminal and as Markdown.

Cells are texts; one between two pairs of asterisks is bold in both.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import rich.table
from rich.console import Console
from rich.text import Text

TABLES_FILE = "PF_TRACKER_TABLES"
"""Environment variable with a file that every table shown is appended to, for `figures.py`."""

Rows = Sequence[Sequence[str]]


@dataclass(frozen=True)
class Table:
    """A table of results."""

    title: str  # its title
    headings: Sequence[str]  # a heading for each column
    groups: Sequence[Rows]  # groups of rows, separated in print
    names: int = 1  # number of columns with names, from the left; the others have figures

    def show(self) -> None:
        """Print on standard output."""
        table = rich.table.Table(title=Text(self.title), title_justify="left")
        for column, heading in enumerate(self.headings):
            if column < self.names:
                table.add_column(Text(heading), overflow="fold")
            else:
                table.add_column(Text(heading), justify="right", min_width=self._width(column))
        for group in self.groups:
            for row in group:
                # As Text, because square brackets in a string are markup in Rich.
                cells = [(cell.strip("*"), "bold" if cell.startswith("**") else "") for cell in row]
                table.add_row(*(Text(*cell) for cell in cells))
            table.add_section()
        self._record()
        console = Console()
        if not console.is_terminal:
            # A pipe has no window width.
            console.width = 1000
        console.print(table)

    def _record(self) -> None:
        """Append it to the file that the environment names, as a line of JSON."""
        if path := os.environ.get(TABLES_FILE):
            rows = [list(row) for group in self.groups for row in group]
            fields = {"title": self.title, "headings": [*self.headings], "rows": rows}
            with Path(path).open("a", encoding="utf-8") as file:
                file.write(json.dumps({**fields, "names": self.names}) + "\n")

    def _width(self, column: int) -> int:
        """Width of the cells in characters; a heading may wrap between its words."""
        cells = [row[column].strip("*") for group in self.groups for row in group]
        return max(map(len, [*cells, *self.headings[column].split()]))

    def markdown(self) -> list[str]:
        """Lines of Markdown without the title, groups in sequence."""
        figures = len(self.headings) - self.names
        alignment = ["---"] * self.names + ["---:"] * figures
        rows = [self.headings, alignment, *(row for group in self.groups for row in group)]
        # A vertical bar would end the cell.
        return ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]


def publish(path: Path | None, tables: Sequence[Table], note: str = "") -> None:
    """Print tables, and write them with a note before them into a Markdown file, if any."""
    for one in tables:
        one.show()
    if path is not None:
        lines = [note, ""] if note else []
        lines += [line for one in tables for line in (f"**{one.title}**", "", *one.markdown(), "")]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines), encoding="utf-8")
        print(f"written: {path}")


def bold(text: str, is_bold: bool = True) -> str:
    """A cell's text, optionally bold."""
    return f"**{text}**" if is_bold else text
