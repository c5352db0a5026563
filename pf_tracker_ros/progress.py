"""A progress bar with the rate and what is left, for people who wait."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_REDRAWN_EVERY = 0.1

OnProgress = Callable[[str, int], None]
"""Told what is worked on, and how much of it is done since it was told last."""


@contextmanager
def progress_bar(total: int | None, unit: str = "frames", name: str = "") -> Iterator[OnProgress]:
    """Show on standard error, if it is a terminal, how far the work is. Needs Rich.

    The bar is gone when the block ends, before a table or an error is printed.

    Args:
        total: How many there are to do, None where that is unknown.
        unit: What is counted.
        name: Of what is worked on first.

    Yields:
        What to call as it goes on.
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
    # Rich would redraw from a thread of its own, whose CPU time would count as the tracker's.
    with Progress(
        *columns,
        console=console,
        auto_refresh=False,
        transient=True,
        disable=not console.is_terminal,
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
