"""A progress bar with rate and remaining time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_REDRAWN_EVERY = 0.1

OnProgress = Callable[[str, int], None]
"""Called with the name of the current item and the units done since the last call."""


@contextmanager
def progress_bar(
    total: int | None, unit: str = "frames", name: str = "", *, shown: bool = True
) -> Iterator[OnProgress]:
    """Show progress on standard error if it is a terminal. Needs Rich.

    The bar disappears at the end of the block.

    Args:
        total: Number of units to do, None if unknown.
        unit: Name of the units.
        name: Name of the first item.
        shown: Whether to show it at all.

    Yields:
        Function that reports progress.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.3g} " + unit + "/s"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # Rich's own refresh thread would add its CPU time to the tracker's.
    with Progress(
        *columns,
        console=console,
        auto_refresh=False,
        transient=True,
        disable=not (shown and console.is_terminal),
    ) as progress:
        task = progress.add_task(name, total=total, rate=0.0)
        began = drawn = time.monotonic()
        count = 0

        def on_progress(name: str, done: int) -> None:
            nonlocal count, drawn
            count += done
            now = time.monotonic()
            rate = count / max(now - began, 1e-9)
            progress.update(task, completed=count, description=name, rate=rate)
            if now - drawn > _REDRAWN_EVERY:
                progress.refresh()
                drawn = now

        yield on_progress
