"""Result files that are rewritten after each result."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pf_tracker_ros.atomic_files import atomic_write, hidden_folder
from pf_tracker_ros.evaluation.plots import check_plot_format, save_success_plot
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceResult
from pf_tracker_ros.evaluation.summary import result_document


class OutputFile:
    """A file that is replaced atomically by each write.

    Attributes:
        error: Error message of the last write, None if it succeeded.

    Args:
        path: The file. The constructor checks that it can be written.

    Raises:
        EvaluationError: It cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.error: str | None = None
        try:
            if path.is_dir():
                raise EvaluationError(f"{path} is a folder; allowed: a file to write")
            if not path.parent.is_dir():
                raise EvaluationError(f"no folder {path.parent} to write {path.name} into")
            if path.exists() and not path.is_file():
                # Replacing a device by a file would remove the device.
                raise EvaluationError(f"{path} is no regular file; allowed: a file to write")
            if path.exists():
                path.open("r+b").close()
            with hidden_folder(path.resolve().parent, ".draft_") as folder:
                (folder / path.name).write_bytes(b"\n")
        except OSError as error:
            raise EvaluationError(_failure(path, error)) from error

    def write(self, write: Callable[[Path], object]) -> str | None:
        """Replace the file.

        Args:
            write: Writes to the path in its argument, which has the file's suffix.

        Returns:
            Error message; None on success, or if the last write had the same error.
        """
        before, self.error = self.error, None
        try:
            with atomic_write(self._path) as draft:
                write(draft)
        except OSError as error:
            self.error = f"{_failure(self._path, error)}; its last version is kept"
        return self.error if self.error != before else None


class ResultFiles:
    """The files that `evaluate` updates after each sequence: results and plot.

    The constructor checks that they can be written.

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


def _failure(path: Path, error: OSError) -> str:
    return f"{path} cannot be written ({error.strerror or type(error).__name__})"
