"""The tuned parameters and their ranges.

A parameter is here if it has a measured effect on the boxes, see `docs/experiments.md`. Others are
left out on purpose: `particles` and `working_size` trade accuracy for time, and thresholds of the
track state depend on the confidence, which the success AUC does not measure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.parameters import Declaration, ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

_DECLARED = declarations(TrackerParameters)
_DIGITS = 3


@dataclass(frozen=True)
class SearchRange:
    """Range of a parameter in the search.

    Attributes:
        low: Smallest value.
        high: Largest value.
        is_logarithmic: Whether values are drawn on a logarithmic scale.
    """

    low: float
    high: float
    is_logarithmic: bool

    def rounded(self, value: float) -> float:
        """The value with three digits, within the range."""
        return min(max(_rounded(value), self.low), self.high)


@dataclass(frozen=True)
class _Between:
    """The same range in every preset."""

    low: float
    high: float

    def around(self, value: float) -> SearchRange | None:
        return SearchRange(min(self.low, value), max(self.high, value), is_logarithmic=False)


@dataclass(frozen=True)
class _Factor:
    """From a fraction to a multiple of the preset's value; none if that is 0."""

    factor: float

    def around(self, value: float) -> SearchRange | None:
        if value <= 0.0:
            return None
        low, high = _rounded(value / self.factor), _rounded(value * self.factor)
        return SearchRange(low, high, is_logarithmic=True)


RANGES: Mapping[str, _Between | _Factor] = {
    "motion.position_noise": _Factor(6.0),
    "motion.velocity_noise": _Factor(6.0),
    "motion.size_noise": _Factor(6.0),
    "proposal.share": _Between(0.2, 0.9),
    "proposal.window": _Between(2.0, 6.0),
    "correlation_response.window": _Between(2.5, 5.5),
    "fusion.adaptation": _Between(0.0, 4.0),
    "template.update_above": _Factor(6.0),
    "template.similarity_above": _Between(0.0, 0.6),
}
"""Full name to range."""

CUE_RANGES: Mapping[str, _Between | _Factor] = {
    "weight": _Between(0.1, 0.9),
    "sharpness": _Factor(4.0),
    "keep": _Between(0.8, 0.99),
}
"""Parameter of any cue to range."""


def search_space(
    preset: str, given: Mapping[str, Any], only: Collection[str] = ()
) -> dict[str, SearchRange]:
    """The parameters to tune, in order of their names, and their ranges.

    Only parameters that are active are tuned. Weights are scaled to a sum of 1, so that of the
    first cue keeps its value.

    Args:
        preset: Name of the preset.
        given: Full name to value of the parameters that differ from it.
        only: Names to tune; empty for all.

    Raises:
        ParameterError: There is no such preset, a name in `only` cannot be tuned, or nothing is
            left to tune.
    """
    own = preset_parameters(preset)
    values = {**own, **given}
    space = {
        name: widened
        for name, one in _tunable(values)
        if (found := one.around(float(own[name]))) is not None
        and (widened := _within(_DECLARED[name], found, float(values[name])))
    }
    for name in only:
        if name not in space:
            raise ParameterError(
                f"parameter '{name}' cannot be tuned here; allowed: {', '.join(sorted(space))}"
            )
    if not space:
        raise ParameterError(f"nothing to tune in preset {preset} with these parameters")
    return {name: space[name] for name in sorted(space) if not only or name in only}


def _tunable(values: Mapping[str, Any]) -> Iterator[tuple[str, _Between | _Factor]]:
    """Names of the active parameters that have a range, and this."""
    weighted = [name for name in values["cues"] if float(values[f"{name}.weight"]) > 0.0]
    for name, one in RANGES.items():
        if _DECLARED[name].is_active(values):
            yield name, one
    for cue in weighted:
        for parameter, one in CUE_RANGES.items():
            name = f"{cue}.{parameter}"
            if name in _DECLARED and not (parameter == "weight" and cue == weighted[0]):
                yield name, one


def _within(declared: Declaration, found: SearchRange, start: float) -> SearchRange:
    """The range within the declared one, widened to contain a start value."""
    return SearchRange(
        max(min(found.low, start), declared.minimum),
        min(max(found.high, start), declared.maximum),
        # A start value of 0 has no logarithm.
        found.is_logarithmic and min(found.low, start) > 0.0,
    )


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
