"""The report of an evaluation, from results to the file."""

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
    """The page of an evaluation; whether it can be written is tried at once.

    Args:
        folder: Where it goes; made where it is missing.
        compared: Files of results to tell the differences to.

    Raises:
        EvaluationError: It cannot be written, or a file of results cannot be read.
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
        """Write the page.

        Args:
            preset: That was evaluated, as `ActivePreset.summary` has it.
            parameters: Where it differs from the preset.
            results: Each sequence, which is read again for its pictures, and its result.

        Returns:
            Why it cannot be written, or a frame not be read; None if all went well.
        """
        sections = []
        for footage, result in results:
            content = content_of(result)
            images = ((index, frame.image) for index, frame in enumerate(footage.frames()))
            try:
                sections.append(Section(content, make_thumbnails([content], images)[0]))
            except FootageError as error:
                return f"there is no report: {error}"
        seeds = len(results[0][1].seeds)
        facts = {
            "preset": preset,
            "parameters": ", ".join(f"{name}={value}" for name, value in parameters.items())
            or "those of the preset",
            "seeds": f"{seeds}" + ("; plots by frame and pictures are of the first" * (seeds > 1)),
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
