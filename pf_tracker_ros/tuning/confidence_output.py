"""The outputs of `tune --confidence`: a ROS parameter file, a page, and a summary."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pf_tracker_ros.evaluation.reports.page import fill
from pf_tracker_ros.evaluation.reports.svg_plots import reliability_plot
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tracking.assessment import ConfidenceCalibration
from pf_tracker_ros.tuning.confidence import (
    CalibrationResult,
    calibration_error,
    reliability,
    roc_area,
)
from pf_tracker_ros.tuning.confidence_run import PARAMETER, ConfidenceRequest, ConfidenceRun
from pf_tracker_ros.tuning.output import ParametersAndPage, given_text, parameter_text


class CalibrationFiles(ParametersAndPage):
    """The files of a calibration; see `ParametersAndPage`.

    Args:
        path: The parameter file.
        request: What is calibrated.
    """

    def __init__(self, path: Path, request: ConfidenceRequest) -> None:
        super().__init__(path)
        self._request = request

    def write_result(self, result: CalibrationResult) -> list[str]:
        """Write both files; the parameter file has the calibration only if it is better.

        Returns:
            Error messages.
        """
        request = self._request
        fitted = {PARAMETER: _values(result.calibration)}
        used, candidate = (fitted, {}) if result.is_better else ({}, fitted)
        verdict = self.verdict(result)
        text = parameter_text(request.preset, {**request.given, **used}, verdict, candidate)
        return self.write_both(text, self._page(result))

    def write_interrupted(self, run: ConfidenceRun) -> str:
        """What an interrupted run keeps."""
        return "the same command continues, and nothing was written yet"

    def summary(self, result: CalibrationResult) -> list[str]:
        """The verdict and the calibration, as lines to print."""
        use = "used" if result.is_better else "fitted, not used"
        scale, offset = _values(result.calibration)
        return [self.verdict(result), f"{use}: {PARAMETER}: scale {scale:g}, offset {offset:g}"]

    def verdict(self, result: CalibrationResult) -> str:
        """What the calibration brings, in two sentences."""
        compared = result.comparison
        low, high = compared.interval
        figures = (
            f"on sequences left out, the Brier score changes from {-compared.preset.mean():.3f} to "
            f"{-compared.tuned.mean():.3f} (lower is better; 95 % interval of the change "
            f"{-high:+.3f} to {-low:+.3f}), and the expected calibration error from "
            f"{calibration_error(result.before):.3f} to {calibration_error(result.left_out):.3f}"
        )
        area = roc_area(result.before)
        told = f"The area under the ROC curve stays {area:.3f}."
        if not np.isfinite(area):
            told = "No box is right, so that nothing can be fitted; check the ground truth."
            if result.before[0].is_right.any():
                told = (
                    "Every box is right, so that nothing can be fitted; add footage on which the "
                    "target is hidden or lost."
                )
        if result.is_better:
            return f"The calibrated confidence is better: {figures}. {told}"
        return f"A calibration is not better by more than chance: {figures}. {told}"

    def _page(self, result: CalibrationResult) -> str:
        from markupsafe import Markup

        request = self._request
        tables = {"before": reliability(result.before), "after": reliability(result.left_out)}
        curves = {
            label: np.array([(row.confidence, row.right) for row in rows if row.share])
            for label, rows in tables.items()
        }
        frames = sum(one.is_right.size for one in result.before)
        groups = min(request.folds, len(result.before))
        return fill(
            "calibration.html.jinja",
            title=f"Confidence of preset {request.preset}",
            facts={
                "preset": request.preset,
                "given parameters": given_text(request.given),
                "calibration": "scale {:g}, offset {:g}".format(*_values(result.calibration)),
                "footage": f"{counted(len(result.before), 'sequence')} in {groups} groups, "
                f"{counted(frames, 'frame')} with {counted(request.seeds, 'seed')}",
            },
            verdict=self.verdict(result),
            is_used=result.is_better,
            plot=Markup(reliability_plot(curves)),
            rows=list(zip(tables["before"], tables["after"], strict=True)),
            comparison=result.comparison,
        )


def _values(calibration: ConfidenceCalibration) -> tuple[float, float]:
    return calibration.scale, calibration.offset
