"""Tables of results, for a terminal and as Markdown.

Cells are texts; one between two pairs of asterisks is bold in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich.console import Console
from rich.text import Text

Rows = Sequence[Sequence[str]]


@dataclass(frozen=True)
class Table:
    """A table of results.

    Attributes:
        title: What the figures are.
        headings: One a column.
        groups: Rows, set apart from each other where they are printed.
        names: The number of columns, from the left, that hold names; the others hold figures.
    """

    title: str
    headings: Sequence[str]
    groups: Sequence[Rows]
    names: int = 1

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
                # As Text: square brackets in a plain string are markup to Rich.
                cells = [(cell.strip("*"), "bold" if cell.startswith("**") else "") for cell in row]
                table.add_row(*(Text(*cell) for cell in cells))
            table.add_section()
        console = Console()
        if not console.is_terminal:
            # What reads from a pipe has no window that the table would have to fit into.
            console.width = 1000
        console.print(table)

    def _width(self, column: int) -> int:
        """Characters that the cells need; a heading may wrap between its words."""
        cells = [row[column].strip("*") for group in self.groups for row in group]
        return max(map(len, [*cells, *self.headings[column].split()]))

    def markdown(self) -> list[str]:
        """Lines of Markdown without the title; the groups follow each other."""
        figures = len(self.headings) - self.names
        alignment = ["---"] * self.names + ["---:"] * figures
        rows = [self.headings, alignment, *(row for group in self.groups for row in group)]
        # A bar in a cell would end it.
        return ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]


def bold(text: str, is_bold: bool = True) -> str:
    """A cell's text, marked as bold or as it is."""
    return f"**{text}**" if is_bold else text
