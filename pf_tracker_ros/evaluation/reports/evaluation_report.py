"""Writes the report of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pf_tracker_ros.evaluation.output_files import OutputFile
from pf_tracker_ros.evaluation.reports.content import content_of
from pf_tracker_ros.evaluation.reports.page import (
    REPORT_FILE,
    Report,
    Section,
    read_results,
    render,
)
from pf_tracker_ros.evaluation.reports.thumbnails import make_thumbnails
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceResult, mean_scores
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.plurals import counted


class EvaluationReport:
    """The report of an evaluation. The constructor checks that it can be written.

    Args:
        folder: Folder of the report, made if missing.
        compared: Result files of other runs to compare with.

    Raises:
        EvaluationError: The report cannot be written, or a result file cannot be read.
    """

    def __init__(self, folder: Path, compared: Sequence[Path]) -> None:
        self._compared = {str(path): read_results(path) for path in compared}
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise EvaluationError(
                f"{folder} cannot be made ({error.strerror or type(error).__name__})"
            ) from error
        self._file = OutputFile(folder / REPORT_FILE)

    def write(
        self,
        preset: str,
        parameters: Mapping[str, Any],
        results: Sequence[tuple[Footage, SequenceResult]],
    ) -> str | None:
        """Write the report.

        Args:
            preset: The evaluated preset, as in `ActivePreset.summary`.
            parameters: Parameters that differ from the preset.
            results: Each sequence, read again for the thumbnails, with its result.

        Returns:
            Error message of the file or of a frame; None on success.
        """
        sections = []
        for footage, result in results:
            content = content_of(result)
            images = ((index, frame.image) for index, frame in enumerate(footage.frames()))
            try:
                sections.append(Section(content, make_thumbnails([content], images)[0]))
            except FootageError as error:
                return f"the report cannot be written: {error}"
        seeds = len(results[0][1].seeds)
        facts = {
            "preset": preset,
            "parameters": ", ".join(f"{name}={value}" for name, value in parameters.items())
            or "those of the preset",
            "seeds": f"{seeds}" + ("; plots over frames and images show the first" * (seeds > 1)),
        }
        report = Report(
            title=f"Evaluation on {counted(len(sections), 'sequence')}: {preset}",
            preset=preset,
            seeds=seeds,
            facts=facts,
            sections=sections,
            mean=mean_scores([result for _, result in results]),
            compared=self._compared,
        )
        page = render(report).encode("utf-8", "replace")
        return self._file.write(lambda path: path.write_bytes(page))
