"""Fusion of several cues into one likelihood, with weights that adapt.

1. The cues are taken as independent: p(Z | X) = prod_k p_k(Z_k | X)^alpha_k, sum_k alpha_k = 1. In
   logarithms this is a weighted sum; alpha_k are the cue weights.
2. In each frame, a searchable cue's distractor ratio is measured: its largest response beside the
   target over that at the target. It is smoothed over frames.
3. A cue whose ratio is below the mean gets more weight, one above it less.
4. The templates of all cues are updated when the fused likelihood and similarity of the estimate
   are high enough.

Source: Li et al. 2007, section 2.2.3 and equations (8) to (10).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.cue import CUES, Cue, Match, PredictedTarget, SearchableCue
from pf_tracker_ros.frames import Region
from pf_tracker_ros.parameters import ParameterError, declared

# Name of a cue to its template, or to its observation.
Templates = Mapping[str, Any]
# Name of a searchable cue to its (N,) responses at N boxes.
Responses = Mapping[str, NDArray[np.float64]]
# Name of a cue to its weight; they sum to 1.
CueWeights = Mapping[str, float]
# Name of a searchable cue to its largest response beside the target / that at the target: 0 without
# a distractor, 1 with an equal one.
DistractorRatios = Mapping[str, float]

_LARGEST_RATIO = 2.0
# Limits of an adapted cue weight, as multiples of the configured one.
_MIN_FACTOR, _MAX_FACTOR = 0.15, 2.0
# Share of a new frame in the smoothed distractor ratios.
_ADAPTATION_RATE = 0.1
# Frames over which the required similarity rises from 0, while the template is still based on few
# frames.
_SETTLING_FRAMES = 40


@dataclass(frozen=True)
class FusionParameters:
    """How the cue weights adapt."""

    adaptation: float = declared(
        1.5,
        "How strongly the cue weights move to the searchable cues that best distinguish the target "
        "from its surroundings; 0 keeps the weights constant.",
        minimum=0.0,
        maximum=10.0,
    )


@dataclass(frozen=True)
class TemplateParameters:
    """When the templates are updated."""

    update_above: float = declared(
        0.1,
        "Update the templates only when the fused likelihood of the estimate exceeds this (w_Th); "
        "1 never updates.",
        minimum=0.0,
        maximum=1.0,
    )
    similarity_above: float = declared(
        0.0,
        "Update the templates only when the box is at least so similar to them, 0 to 1; the limit "
        "rises from 0 to this value over the first 40 frames. After a sudden change of "
        "illumination they are updated in any case.",
        minimum=0.0,
        maximum=1.0,
    )

    def required_similarity(self, frames: int) -> float:
        """The smallest similarity for a template update so many frames after the first, 0 to 1."""
        return self.similarity_above * min(frames / _SETTLING_FRAMES, 1.0)


def measure_distractor_ratios(
    at_target: Mapping[str, float], beside: Responses
) -> DistractorRatios:
    """Each cue's largest of (N,) responses beside the target, N >= 0, / that at the target."""
    return {
        name: min(max(float(beside[name].max(initial=0.0)), 0.0) / max(own, 1e-3), _LARGEST_RATIO)
        for name, own in at_target.items()
    }


def smooth_distractor_ratios(before: DistractorRatios, now: DistractorRatios) -> DistractorRatios:
    """Exponentially smoothed ratios of the frames before and this one."""
    rate = _ADAPTATION_RATE
    return {
        name: rate * value + (1.0 - rate) * before.get(name, value) for name, value in now.items()
    }


class CueFusion:
    """Several cues as one: the product of their weighted likelihoods, equation (8).

    Args:
        cues: Name to (cue, weight); weights >= 0 are scaled to a sum of 1, and cues of weight 0 are
            left out.

    Attributes:
        cue_weights: Name of a cue to its configured weight; they sum to 1.
        can_search: Whether any cue is searchable.
        context_margin: Largest margin around a box that a cue reads, in box sides.
        needs_foreground: Whether any cue reads the foreground.
        uses_center_box_size: Whether any cue reads every box in the size of `Region.center_box`.

    Raises:
        ParameterError: There is no cue, or no weight is above 0.
    """

    def __init__(self, cues: Mapping[str, tuple[Cue, float]]) -> None:
        used = {name: entry for name, entry in cues.items() if entry[1] > 0.0}
        if not cues:
            raise ParameterError(
                f"parameter 'cues' is empty; allowed: at least one of {', '.join(CUES)}"
            )
        if not used:
            names = ", ".join(f"'{name}.weight'" for name in cues)
            raise ParameterError(f"all cues are off; at least one of {names} must be above 0")
        total = sum(weight for _, weight in used.values())
        self._cues = {name: cue for name, (cue, _) in used.items()}
        self._searchable = {
            name: cue for name, cue in self._cues.items() if isinstance(cue, SearchableCue)
        }
        self.cue_weights: CueWeights = {name: weight / total for name, (_, weight) in used.items()}
        self.can_search = bool(self._searchable)
        self.context_margin = max(cue.context_margin for cue in self._cues.values())
        self.needs_foreground = any(cue.needs_foreground for cue in self._cues.values())
        self.uses_center_box_size = any(cue.uses_center_box_size for cue in self._cues.values())

    def learn(self, region: Region, box: NDArray[np.float64]) -> Templates:
        """Each cue's template of a (4,) box."""
        return {name: cue.learn(region, box) for name, cue in self._cues.items()}

    def precompute(self, predicted_targets: Sequence[tuple[Region, Templates]]) -> None:
        """Compute maps of several regions at once; see `Cue.precompute`."""
        for name, cue in self._cues.items():
            with_template = [
                PredictedTarget(region, templates[name])
                for region, templates in predicted_targets
                if name in templates
            ]
            if with_template:
                cue.precompute(with_template)

    def observe(self, region: Region, box: NDArray[np.float64]) -> Templates:
        """Each cue's observation of a (4,) box; see `Cue.observe`."""
        return {name: cue.observe(region, box) for name, cue in self._cues.items()}

    def log_likelihood(
        self,
        region: Region,
        boxes: NDArray[np.float64],
        templates: Templates,
        cue_weights: CueWeights | None = None,
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X) <= 0 of (N, 4) boxes; source: Li et al. 2007, equation (8).

        `cue_weights` default to the configured ones. Cues without a template, which were switched
        on while tracking, are ignored.
        """
        fused = np.zeros(len(boxes))
        cue_weights = cue_weights or self.cue_weights
        for name, cue, template in self._with_template(templates):
            fused += cue_weights[name] * cue.log_likelihood(region, boxes, template)
        return fused

    def log_likelihoods(
        self, region: Region, boxes: NDArray[np.float64], templates: Templates
    ) -> dict[str, NDArray[np.float64]]:
        """Name of each cue with a template to its (N,) log likelihoods of (N, 4) boxes."""
        return {
            name: cue.log_likelihood(region, boxes, template)
            for name, cue, template in self._with_template(templates)
        }

    def searches(self, templates: Templates) -> bool:
        """Whether any searchable cue has a template."""
        return any(name in templates for name in self._searchable)

    def responses(
        self, region: Region, boxes: NDArray[np.float64], templates: Templates
    ) -> Responses:
        """Name of each searchable cue to its (N,) responses at (N, 4) boxes."""
        return {
            name: cue.response(region, boxes, templates[name])
            for name, cue in self._searchable.items()
            if name in templates
        }

    def responses_on_grid(self, region: Region, grid: BoxGrid, templates: Templates) -> Responses:
        """Name of each searchable cue to its (M,) responses at the boxes of a grid."""
        return {
            name: cue.response_on_grid(region, grid, templates[name])
            for name, cue in self._searchable.items()
            if name in templates
        }

    def search(
        self,
        region: Region,
        grid: BoxGrid,
        responses: Responses,
        templates: Templates,
        cue_weights: CueWeights,
    ) -> NDArray[np.float64]:
        """(M,) log likelihoods of the boxes of a grid, by the cues that search or join a search.

        `responses` are those of at least one searchable cue on that grid.
        """
        fused = np.zeros(len(grid.left) * len(grid.top))
        for name, response in responses.items():
            likelihood = self._searchable[name].log_likelihood_of(response, templates[name])
            fused += cue_weights[name] * likelihood
        for name, cue, template in self._with_template(templates):
            if cue.joins_search:
                fused += cue_weights[name] * cue.log_likelihood_on_grid(region, grid, template)
        return fused

    def log_growth(self, region: Region, box: NDArray[np.float64], templates: Templates) -> float:
        """See `SearchableCue.log_growth`; that of the first cue that tells one."""
        growths = (
            cue.log_growth(region, box, templates[name])
            for name, cue in self._searchable.items()
            if name in templates
        )
        return next((one for one in growths if one), 0.0)

    def adapt(self, distractor_ratios: DistractorRatios, adaptation: float) -> CueWeights:
        """The cue weights, raised for cues of below-average distractor ratio; they sum to 1."""
        if not (distractor_ratios and adaptation):
            return self.cue_weights
        mean = sum(distractor_ratios.values()) / len(distractor_ratios)
        cue_weights = {
            name: weight
            * min(
                max(1.0 + adaptation * (mean - distractor_ratios.get(name, mean)), _MIN_FACTOR),
                _MAX_FACTOR,
            )
            for name, weight in self.cue_weights.items()
        }
        total = sum(cue_weights.values())
        return {name: weight / total for name, weight in cue_weights.items()}

    def match(self, observation: Templates, templates: Templates) -> Match:
        """Match of the observation of a box, fused by equation (8).

        The weights of the cues that can decide are scaled to a sum of 1; without any, the match is
        perfect. The similarity is that of the discriminative cues, if there are any.
        """
        matches = [
            (cue.is_discriminative, self.cue_weights[name], match)
            for name, cue, template in self._with_template(templates)
            if (match := cue.match(observation[name], template))
        ]
        discriminative = [entry for entry in matches if entry[0]] or matches
        total = sum([weight for _, weight, _ in matches])
        of_these = sum([weight for _, weight, _ in discriminative])
        return Match(
            sum([weight / total * match.log_likelihood for _, weight, match in matches]),
            math.prod(
                [match.similarity ** (weight / of_these) for _, weight, match in discriminative]
            ),
        )

    def log_odds(self, observation: Templates, templates: Templates) -> dict[str, float]:
        """Log odds of all cues, see `Cue.log_odds`; terms are named `<cue>.<term>`."""
        return {
            f"{name}.{term}": odds
            for name, cue, template in self._with_template(templates)
            for term, odds in cue.log_odds(observation[name], template).items()
        }

    def update(self, templates: Templates, observation: Templates) -> Templates:
        """The templates, updated by the observation at a trusted estimate.

        Templates of cues of weight 0 are kept.

        Source: Li et al. 2007, equations (9) and (10).
        """
        return dict(templates) | {
            name: cue.blend(templates[name], observation[name])
            if name in templates
            else cue.template_from(observation[name])
            for name, cue in self._cues.items()
        }

    def _with_template(self, templates: Templates) -> list[tuple[str, Cue, Any]]:
        """Name, cue and template of each cue that has one."""
        return [
            (name, cue, templates[name]) for name, cue in self._cues.items() if name in templates
        ]
