"""A progress bar with frames a second and what is left."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_REDRAWN_EVERY = 0.1


@contextmanager
def progress_bar(
    name: str, total: int | None, unit: str = "frames"
) -> Iterator[Callable[[], None]]:
    """Show on standard error, if it is a terminal, how far the work is. Needs Rich.

    Args:
        name: Of the recording, or of what else is worked through.
        total: Its frames, None where that is unknown.
        unit: What is counted.

    Yields:
        What to call after each of them.
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
    # Rich would redraw from a thread of its own, beside those that track and encode.
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

        def advance() -> None:
            nonlocal count, drawn
            count += 1
            now = time.monotonic()
            if now - drawn > _REDRAWN_EVERY:
                progress.update(task, completed=count, rate=count / (now - began))
                progress.refresh()
                drawn = now

        yield advance
