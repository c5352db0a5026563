"""A progress bar for people who wait for an evaluation."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from pf_tracker_ros.evaluation.runner import OnProgress
from pf_tracker_ros.footage import Footage


def frame_count(sequences: Sequence[Footage]) -> int:
    """Number of frames with a true box of all sequences."""
    return sum(0 if one.ground_truth is None else len(one.ground_truth) for one in sequences)


@contextmanager
def progress_bar(total: int) -> Iterator[OnProgress]:
    """Show on standard error, if it is a terminal, how many frames are done. Needs Rich.

    The bar is gone when the block ends, before a table or an error is printed.

    Args:
        total: Number of frames to do.

    Yields:
        What to call with a text and the number of frames done since the last call.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    # Rich would redraw from a thread of its own, whose CPU time would count as the tracker's.
    console = Console(stderr=True)
    with Progress(
        *columns,
        console=console,
        auto_refresh=False,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task("", total=total)
        drawn = 0.0

        def on_progress(name: str, frames: int) -> None:
            nonlocal drawn
            progress.update(task, advance=frames, description=name)
            if time.monotonic() - drawn > 0.1:
                progress.refresh()
                drawn = time.monotonic()

        yield on_progress
