"""A progress bar for people who wait for work to be done."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_REDRAWN_EVERY = 0.1


@contextmanager
def progress_bar(
    total: int | None, name: str = "", unit: str = "frames"
) -> Iterator[Callable[[str, int], None]]:
    """Show on standard error, if it is a terminal, how far the work is. Needs Rich.

    The bar is gone when the block ends, before a table or an error is printed.

    Args:
        total: How many there are to do, None where that is unknown.
        name: Of what is worked on first.
        unit: What is counted.

    Yields:
        What to call with the name of what is worked on, and the number done since the last call.
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
    # Rich would redraw from a thread of its own, whose CPU time would count as the tracker's.
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.3g} " + unit + "/s"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        auto_refresh=False,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(name, total=total, rate=0.0)
        began = drawn = time.monotonic()
        count = 0

        def advance(name: str, more: int) -> None:
            nonlocal count, drawn
            count += more
            now = time.monotonic()
            rate = count / max(now - began, _REDRAWN_EVERY)
            progress.update(task, completed=count, description=name, rate=rate)
            if now - drawn > _REDRAWN_EVERY:
                progress.refresh()
                drawn = now

        yield advance
