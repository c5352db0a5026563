"""The files that `evaluate` updates after each sequence: results and plot."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pf_tracker_ros.evaluation.output_files import OutputFile
from pf_tracker_ros.evaluation.plots import check_plot_format, save_success_plot
from pf_tracker_ros.evaluation.results import SequenceResult
from pf_tracker_ros.evaluation.summary import result_document


class ResultFiles:
    """The requested files. The constructor checks that they can be written.

    Args:
        document: JSON file of the results, None for none.
        plot: Image file of the success plot, None for none.
        preset: The evaluated preset.
        parameters: Parameters that differ from the preset.
        label: Label of the curve in the plot.

    Raises:
        EvaluationError: A file cannot be written, or the plot's format is not supported.
    """

    def __init__(
        self,
        document: Path | None,
        plot: Path | None,
        preset: str,
        parameters: Mapping[str, Any],
        label: str,
    ) -> None:
        self._preset = preset
        self._parameters = parameters
        self._label = label
        if plot is not None:
            check_plot_format(plot)
        requested = ((document, self._write_document), (plot, self._draw))
        self._files = [(OutputFile(path), write) for path, write in requested if path is not None]

    @property
    def are_written(self) -> bool:
        """Whether the last write of every file succeeded."""
        return all(file.error is None for file, _ in self._files)

    def write(self, results: Sequence[SequenceResult]) -> list[str]:
        """Rewrite the files.

        Returns:
            New error messages.
        """
        failures = [file.write(functools.partial(write, results)) for file, write in self._files]
        return [failure for failure in failures if failure is not None]

    def _write_document(self, results: Sequence[SequenceResult], path: Path) -> None:
        document = result_document(self._preset, self._parameters, results)
        path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def _draw(self, results: Sequence[SequenceResult], path: Path) -> None:
        curves = {result.name: result.success_curve for result in results}
        mean = np.mean(list(curves.values()), axis=0)
        save_success_plot(path, {self._label: mean}, details=curves)
