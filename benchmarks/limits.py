"""Measured figures with limits."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tables import Table, bold


@dataclass(frozen=True)
class Limit:
    """A figure with its limit.

    Attributes:
        name: Name of the figure.
        value: The figure.
        bound: Its limit.
        is_least: Whether the bound is a minimum instead of a maximum.
        unit: Unit of both.
    """

    name: str
    value: float
    bound: float
    is_least: bool = False
    unit: str = ""

    @property
    def is_met(self) -> bool:
        """Whether the figure is within the limit; NaN is not."""
        return self.value >= self.bound if self.is_least else self.value <= self.bound


def limits_table(bars: Sequence[Limit]) -> Table:
    """A table of the limits; missed ones are bold."""
    rows = [
        [
            bar.name,
            f"{bar.value:.2f}{bar.unit}",
            f"{'at least' if bar.is_least else 'at most'} {bar.bound:g}{bar.unit}",
            bold("met" if bar.is_met else "MISSED", not bar.is_met),
        ]
        for bar in bars
    ]
    return Table("What must hold", ["", "measured", "bar", ""], [rows])


def save_tables(
    path: Path | None, tables: Sequence[Table], script: str, arguments: Sequence[str] | None
) -> None:
    """Write tables with their titles, and the command to reproduce them.

    Args:
        path: A Markdown file; None for none.
        tables: The tables, in order.
        script: File name of the benchmark.
        arguments: Its command line; None for the process'.
    """
    if path is None:
        return
    command = shlex.join(["python", f"benchmarks/{script}", *(arguments or sys.argv[1:])])
    lines = [f"`{command}`", ""]
    for table in tables:
        lines += [f"**{table.title}**", "", *table.markdown(), ""]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines), encoding="utf-8")
