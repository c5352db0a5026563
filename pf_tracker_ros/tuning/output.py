"""The outputs of a search: a ROS parameter file, a page, and a summary."""

from __future__ import annotations

import hashlib
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pf_tracker_ros.evaluation.output_files import OutputFile
from pf_tracker_ros.evaluation.reports.page import fill
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import read_file
from pf_tracker_ros.parameter_files import section_lines, yaml_text
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tuning.comparison import Comparison
from pf_tracker_ros.tuning.evaluations import TunedValues
from pf_tracker_ros.tuning.search import TuningRequest
from pf_tracker_ros.tuning.tuning import Tuning, TuningResult

_LINE_LENGTH = 100
# Bytes of an output that is read back.
_MAX_BYTES = 100 * 10**6


class ParametersAndPage:
    """A parameter file and the page beside it. The constructor checks that they can be written.

    The last line of each has the hash of the lines above it. A file that was changed since is not
    replaced.

    Args:
        path: The parameter file.

    Attributes:
        path: Path of the parameter file.
        page: Path of the page.

    Raises:
        EvaluationError: A file cannot be written, or was changed since tune wrote it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.page = path.with_suffix(".html")
        for each in (self.path, self.page):
            if each.is_file() and not _is_unchanged(each):
                raise EvaluationError(
                    f"{each} was changed since tune wrote it, and is not replaced; rename it, or "
                    "choose another --output"
                )
        self._parameter_file = OutputFile(path)
        self._page_file = OutputFile(self.page)

    def write_parameters(self, text: str) -> str | None:
        """Write the parameter file; an error message or None."""
        content = f"{text}# {_hash_text(text.encode())}\n"
        return self._parameter_file.write(lambda path: path.write_text(content, encoding="utf-8"))

    def write_both(self, text: str, page: str) -> list[str]:
        """Write the parameter file and the page; error messages."""
        content = f"{page}\n".encode("utf-8", "replace")
        content += f"<!-- {_hash_text(content)} -->\n".encode()
        errors = [
            self.write_parameters(text),
            self._page_file.write(lambda path: path.write_bytes(content)),
        ]
        return [error for error in errors if error is not None]


def _hash_text(content: bytes) -> str:
    return f"SHA-256 of the lines above: {hashlib.sha256(content).hexdigest()}"


def _is_unchanged(path: Path) -> bool:
    try:
        content = read_file(path, "output", _MAX_BYTES)
    except FootageError as error:
        raise EvaluationError(str(error)) from error
    above, newline, last = content.removesuffix(b"\n").rpartition(b"\n")
    return _hash_text(above + newline).encode() in last


class TuningFiles(ParametersAndPage):
    """The files of a search; see `ParametersAndPage`.

    Args:
        path: The parameter file.
        request: What is tuned.
    """

    def __init__(self, path: Path, request: TuningRequest) -> None:
        super().__init__(path)
        self._request = request

    def write_result(self, result: TuningResult) -> list[str]:
        """Write both files; the parameter file has the preset's values unless others are better.

        Returns:
            Error messages.
        """
        is_used = self.uses(result)
        values = result.values if is_used else self._request.own
        candidate = {} if is_used else self._changes(result.values)
        page = fill(
            "tuning.html.jinja",
            title=f"Tuning of preset {self._request.preset}",
            facts=self._facts(result),
            verdict=self.verdict(result),
            changes=self.changed(result),
            is_used=is_used,
            comparison=result.comparison,
            seen=result.seen,
        )
        return self.write_both(self._parameters(values, self.verdict(result), candidate), page)

    def write_interrupted(self, tuning: Tuning) -> str:
        """Write the best values of an interrupted run.

        Returns:
            What was kept, or an error message.
        """
        trials = tuning.trials
        told = (
            f"Interrupted after {trials} of {counted(self._request.trials, 'trial')}: the best "
            "values so far, not tested on sequences left out."
        )
        error = self.write_parameters(self._parameters(tuning.best, told, {}))
        return error or f"{self.path} has the best values so far"

    def summary(self, result: TuningResult) -> list[str]:
        """The verdict and the values, as lines to print."""
        lines = [self.verdict(result)]
        if changed := self.changed(result):
            lines.append("used:" if self.uses(result) else "best values found, not used:")
        return lines + [
            f"  {name}: {after:g} instead of {before:g}" for name, before, after in changed
        ]

    def uses(self, result: TuningResult) -> bool:
        """Whether the values found are better than the preset, and in the parameter file."""
        return bool(self._changes(result.values)) and result.comparison.is_significant

    def changed(self, result: TuningResult) -> list[tuple[str, float, float]]:
        """Name, value of the preset and value found on all sequences, where they differ."""
        return [
            (name, self._request.own[name], value)
            for name, value in self._changes(result.values).items()
        ]

    def verdict(self, result: TuningResult) -> str:
        """What tuning brought, in one or two sentences."""
        compared = result.comparison
        figures = (
            f"on sequences left out, the success AUC changes from {compared.preset.mean():.3f} to "
            f"{compared.tuned.mean():.3f}: {gain_text(compared)}"
        )
        if not self._changes(result.values):
            if np.array_equal(compared.preset, compared.tuned):
                return f"No search found anything better than the preset; {figures}."
            proven = "is proven" if compared.is_significant else "is not proven"
            return (
                "The search on all sequences found nothing better than the preset. Those without a "
                f"group of sequences found other values, whose gain {proven}: {figures}."
            )
        if self.uses(result):
            return f"The tuned values are better than the preset: {figures}."
        return f"Nothing is better than the preset by more than chance: {figures}."

    def _changes(self, values: TunedValues) -> dict[str, float]:
        """The values that differ from the preset."""
        return {name: each for name, each in values.items() if each != self._request.own[name]}

    def _parameters(self, values: TunedValues, told: str, candidate: Mapping[str, float]) -> str:
        """Text of the parameter file."""
        parameters = {**self._request.fixed, **self._changes(values)}
        return parameter_text(self._request.preset, parameters, told, candidate)

    def _facts(self, result: TuningResult) -> dict[str, str]:
        request = self._request
        searches = 1 + min(request.folds, len(result.comparison.names))
        return {
            "preset": request.preset,
            "given parameters": given_text(request.given),
            "search": f"{counted(request.trials, 'trial')} of {counted(request.seeds, 'seed')}, "
            f"in {searches} searches",
            "tuned parameters": ", ".join(request.space),
        }


def parameter_text(
    preset: str, parameters: Mapping[str, Any], told: str, candidate: Mapping[str, Any]
) -> str:
    """Text of a ROS parameter file.

    Args:
        preset: The preset.
        parameters: Full name to value of the parameters that differ from it.
        told: A comment.
        candidate: Full name to value of parameters for another comment, as they are not used.
    """
    lines = textwrap.wrap(
        told, _LINE_LENGTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )
    if candidate:
        lines.append("# The best values found, which are not used:")
        lines += [f"#   {name}: {yaml_text(value)}" for name, value in candidate.items()]
    lines += section_lines("/**", {"preset": preset, **parameters})
    return "\n".join(lines) + "\n"


def given_text(given: Mapping[str, Any]) -> str:
    """Given parameters, for the facts of a page."""
    return ", ".join(f"{name}={value}" for name, value in given.items()) or "none"


def gain_text(compared: Comparison) -> str:
    """The gain with its interval."""
    low, high = compared.interval
    return (
        f"{compared.gain:+.3f} (95 % interval {low:+.3f} to {high:+.3f}; standard error of the "
        f"seeds {compared.seed_error:.3f})"
    )
