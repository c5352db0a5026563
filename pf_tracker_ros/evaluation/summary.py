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

    `preset`; `seeds`, their number; `sequences`, of each name the four figures of `Scores`; `mean`,
    the same four, `frames` included, averaged over the sequences. Only where parameters differ from
    the preset are they listed too, under `parameters`.

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
    What the output's encoding lacks is written in ASCII. Needs Rich.

    Raises:
        ValueError: There is no result.
        BrokenPipeError: Nobody reads the output; all further output goes nowhere.
        OSError: It cannot be written for another reason; likewise.
    """
    from rich.console import Console

    if sys.stdout is None:
        # The output was closed before the program began; print() says nothing then either.
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
        # Python writes at its end what is still held back, and would complain again.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
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
    # Names go in as Text: square brackets in a plain string are markup to Rich.
    for result in results:
        table.add_row(
            Text(result.name), *_cells(result.scores, result.success_auc_std, frames=".0f")
        )
    table.add_section()
    deviation = sum(result.success_auc_std for result in results) / len(results)
    table.add_row("mean", *_cells(mean, deviation, frames=".1f"), style="bold")
    return table


def _cells(scores: Scores, deviation: float, frames: str) -> list[str]:
    return [
        format(scores.frames, frames),
        f"{scores.success_auc:.3f}",
        "" if math.isnan(deviation) else f"{deviation:.3f}",
        f"{scores.precision_20px:.3f}",
        f"{scores.cpu_ms_median:.2f}",
    ]
