"""Presets: named sets of parameter values over the declared defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from pf_tracker_ros.parameters import ParameterError, build, flatten
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tracking.parameters import TrackerParameters

_OUTLINE_SHARPNESS = 300.0
# Zhang et al. 2015, sections 3.2 and 4, renew the template above a similarity 1 - D of 0.65. As a
# likelihood, exp(-lambda D^2 / 2), this is:
_OUTLINE_UPDATE_ABOVE = math.exp(-_OUTLINE_SHARPNESS * (1.0 - 0.65) ** 2 / 2.0)

_DEFAULT: dict[str, Any] = {
    "particles": 200,
    "follow_light": True,
    "motion.model": "constant_velocity_and_size",
    "motion.position_noise": 0.6,
    "motion.size_noise": 0.05,
    "motion.aspect_noise": 0.0,
    "proposal.method": "search",
    "proposal.share": 0.6,
    "cues": ("color_contrast", "correlation_response"),
    "template.update_above": 0.0,
    "template.similarity_above": 0.33,
    "track.wrong_box_cost": 1.75,
    "track.occlusion_policy": "keep_tracking",
}
# Values for several targets: fewer particles for each, and a narrower search, since similar targets
# are often close. The foreground keeps a target off the static background that it passes.
_FOR_SEVERAL: Mapping[str, Mapping[str, Any]] = {
    "default": {
        "particles": 100,
        "proposal.window": 2.0,
        "cues": ("color_contrast", "coarse_correlation_response", "foreground"),
        "foreground.sharpness": 60.0,
    }
}

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "default": MappingProxyType(_DEFAULT),
        "li2007": MappingProxyType(
            {
                "particles": 60,
                "motion.model": "constant_velocity",
                "motion.position_noise": 0.7,
                "cues": ("color_histogram", "gradient_orientation"),
                "gradient_orientation.sharpness": 30.0,
                "template.update_above": 0.2,
            }
        ),
        "zhang2015": MappingProxyType(
            {
                "particles": 100,
                "motion.model": "second_order_autoregressive",
                "motion.position_noise": 0.5,
                "resampling.scheme": "multinomial_elitist",
                "working_size": 120,
                "cues": ("hog",),
                "hog.sharpness": _OUTLINE_SHARPNESS,
                "template.update_above": _OUTLINE_UPDATE_ABOVE,
                "track.wrong_box_cost": 1.5,
            }
        ),
        "zhang_bo": MappingProxyType(
            {
                "particles": 100,
                "motion.model": "affine",
                "motion.position_noise": 0.4,
                "motion.velocity_noise": 0.2,
                "motion.size_noise": 0.15,
                "proposal.method": "kalman",
                "proposal.share": 0.3,
                "resampling.scheme": "multinomial",
                "cues": ("foreground_color_histogram", "gradient_orientation", "foreground"),
                "foreground_color_histogram.weight": 0.5,
                "gradient_orientation.weight": 0.25,
                "foreground.weight": 0.25,
            }
        ),
    }
)


def preset_parameters(name: str, max_targets: int = 1) -> dict[str, Any]:
    """All parameter values of a preset.

    Args:
        name: A key of `PRESETS`.
        max_targets: Maximum number of targets; above 1, the values are those for several.

    Returns:
        Full parameter name to value, in order of declaration.

    Raises:
        ParameterError: No preset has this name; names the presets.
    """
    if name not in PRESETS:
        raise ParameterError(f"no preset '{name}'; there are: {', '.join(PRESETS)}")
    several = _FOR_SEVERAL.get(name, {}) if max_targets > 1 else {}
    values = {**PRESETS[name], **several, "max_targets": max_targets}
    return flatten(build(TrackerParameters, values))


@dataclass(frozen=True)
class ActivePreset:
    """A preset and the parameters that differ from it.

    Attributes:
        name: A key of `PRESETS`.
        changes: Full parameter name to (current value, value of the preset), where they differ.
    """

    name: str
    changes: Mapping[str, tuple[Any, Any]]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> ActivePreset:
        """Compare `preset` and every parameter of the tracker, by full name, with that preset."""
        name = values["preset"]
        preset = preset_parameters(name, values["max_targets"])
        changes = {
            parameter: (values[parameter], value)
            for parameter, value in preset.items()
            if parameter in values and values[parameter] != value
        }
        return cls(name, changes)

    @property
    def summary(self) -> str:
        """The name and the number of changes, for example `li2007, 3 values changed`."""
        count = len(self.changes)
        if count == 0:
            return self.name
        return f"{self.name}, {counted(count, 'value')} changed"

    @property
    def description(self) -> str:
        """The summary and the changes."""
        if not self.changes:
            return self.name
        changes = ", ".join(
            f"{name} {_text(value)} instead of {_text(default)}"
            for name, (value, default) in self.changes.items()
        )
        return f"{self.summary}: {changes}"


def _text(value: Any) -> str:
    return f"[{', '.join(map(str, value))}]" if isinstance(value, tuple) else str(value)
