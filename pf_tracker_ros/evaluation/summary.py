"""Results as a JSON document and as a table."""

from __future__ import annotations

import dataclasses
import math
import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pf_tracker_ros.evaluation.results import Scores, SequenceResult, mean_scores

if TYPE_CHECKING:
    from rich.table import Table


def result_document(
    preset: str, parameters: Mapping[str, Any], results: Sequence[SequenceResult]
) -> dict[str, Any]:
    """The results as a JSON object.

    Its keys are `preset`, `parameters` (only if some differ from the preset), `seeds` (number),
    `sequences` (name to the four figures of `Scores`) and `mean` (the same four).

    Raises:
        ValueError: There is no result.
    """
    overrides = {"parameters": dict(parameters)} if parameters else {}
    mean = mean_scores(results)
    return {
        "preset": preset,
        **overrides,
        "seeds": len(results[0].seeds),
        "sequences": {result.name: dataclasses.asdict(result.scores) for result in results},
        "mean": dataclasses.asdict(mean),
    }


def print_table(title: str, results: Sequence[SequenceResult]) -> None:
    """Print the figures of each sequence, and their means, on standard output.

    The column after the success AUC is its standard deviation over the seeds, empty for one seed.
    Characters outside the output's encoding are escaped. Needs Rich.

    Raises:
        ValueError: There is no result.
        BrokenPipeError: The output was closed; further output is discarded.
        OSError: Another error of the output; likewise.
    """
    from rich.console import Console

    if sys.stdout is None:
        # The output was closed before the start; print() is silent then, too.
        return
    console = Console()
    encoding = sys.stdout.encoding or "utf-8"
    with console.capture() as capture:
        console.print(_table(title, results, encoding))
    text = capture.get().encode(encoding, "backslashreplace").decode(encoding)
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError:
        # Python flushes its buffer at exit, and would raise again.
        null_device = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null_device, sys.stdout.fileno())
        os.close(null_device)
        raise


def _table(title: str, results: Sequence[SequenceResult], encoding: str) -> Table:
    from rich.table import Table
    from rich.text import Text

    mean = mean_scores(results)
    table = Table(title=Text(title), title_justify="left")
    table.add_column("sequence", overflow="fold")
    plus_minus = "±" if "±".encode(encoding, "ignore") else "+-"
    for heading in ("frames", "AUC", plus_minus, "precision 20 px", "CPU ms"):
        table.add_column(heading, justify="right")
    # As Text, because square brackets in a string are markup in Rich.
    for result in results:
        table.add_row(
            Text(result.name), *_cells(result.scores, result.success_auc_std, frames=".0f")
        )
    table.add_section()
    mean_std = sum(result.success_auc_std for result in results) / len(results)
    table.add_row("mean", *_cells(mean, mean_std, frames=".1f"), style="bold")
    return table


def _cells(scores: Scores, success_auc_std: float, frames: str) -> list[str]:
    return [
        format(scores.frames, frames),
        f"{scores.success_auc:.3f}",
        "" if math.isnan(success_auc_std) else f"{success_auc_std:.3f}",
        f"{scores.precision_20px:.3f}",
        f"{scores.cpu_ms_median:.2f}",
    ]
