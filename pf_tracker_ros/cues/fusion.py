"""Several cues fused into one likelihood, and their templates kept up to date."""

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

# Name of a cue to its template.
Templates = Mapping[str, Any]
# Name of a searchable cue to its (N,) strengths at N boxes.
Responses = Mapping[str, NDArray[np.float64]]
# Name of a cue to its weight; they sum to 1.
CueWeights = Mapping[str, float]
# Name of a searchable cue to its strength at the likeliest place beside the target, as a share of
# the one at the target: 0 where nothing around looks like the target, 1 where something does.
DistractorRatios = Mapping[str, float]

_LARGEST_DISTRACTION = 2.0
# However little a cue tells at the moment, it keeps this share of its weight, and never gets more
# than this multiple of it.
_LEAST_POWER, _MOST_POWER = 0.15, 2.0
# Share of each frame in what is known of how well a cue tells the target.
_ADAPTATION_RATE = 0.1
# Frames, from the first on, over which the confidence that learning asks for rises from 0: few
# views do not yet tell what the target looks like in the next one.
_SETTLING_FRAMES = 40


@dataclass(frozen=True)
class FusionParameters:
    """How the cues' powers follow what each can tell."""

    adaptation: float = declared(
        1.5,
        "How strongly the powers move to the cues that tell the target from what is around it "
        "(those that can search); 0 keeps the powers as they are.",
        minimum=0.0,
        maximum=10.0,
    )


@dataclass(frozen=True)
class TemplateParameters:
    """When and how fast the templates follow the target."""

    update_above: float = declared(
        0.1,
        "The templates are updated only when the fused likelihood of the estimate exceeds this "
        "(w_Th); 1 never updates.",
        minimum=0.0,
        maximum=1.0,
    )
    similarity_above: float = declared(
        0.0,
        "No template is updated unless what the box holds looks at least so much like it, 0 to 1 "
        "as a confidence; the least rises from 0 to this over the first 40 frames. Light that "
        "jumps is learned all the same.",
        minimum=0.0,
        maximum=1.0,
    )

    def required_similarity(self, frames: int) -> float:
        """The least similarity that lets the templates be updated, 0 to 1.

        Args:
            frames: For which the target has been followed.
        """
        return self.similarity_above * min(frames / _SETTLING_FRAMES, 1.0)


def measure_distractor_ratios(
    at_target: Mapping[str, float], beside: Responses
) -> DistractorRatios:
    """Each cue's largest strength beside the target over that at the target.

    Args:
        at_target: Name to strength.
        beside: Name to (N,) strengths; N may be 0.
    """
    return {
        name: min(
            max(float(beside[name].max(initial=0.0)), 0.0) / max(own, 1e-3), _LARGEST_DISTRACTION
        )
        for name, own in at_target.items()
    }


def smooth_distractor_ratios(before: DistractorRatios, now: DistractorRatios) -> DistractorRatios:
    """The distraction of this frame mixed into that of the frames before."""
    rate = _ADAPTATION_RATE
    return {
        name: rate * value + (1.0 - rate) * before.get(name, value) for name, value in now.items()
    }


class CueFusion:
    """Any number of cues as one: the product of their likelihoods' powers.

    p(Z | X) = prod_k p_k(Z_k | X)^alpha_k with sum_k alpha_k = 1.

    Source: Li et al. 2007, section 2.2.3 and equation (8).

    Args:
        cues: Name to (cue, weight); powers of at least 0 are scaled to a sum of 1, and a cue of
            weight 0 is left out, so that it costs nothing.

    Attributes:
        cue_weights: Name of a cue to its weight as configured; they sum to 1.
        can_search: Whether any of the cues can look for the target.
        context_margin: How far beyond each side of a box the cues look at most, in box sides.
        needs_foreground: Whether any of the cues asks for the foreground.
        uses_center_box_size: Whether any of the cues looks at every box in the size of `Region.center_box`.

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
        """Each cue's template of what is in a (4,) box."""
        return {name: cue.learn(region, box) for name, cue in self._cues.items()}

    def precompute(self, predicted_targets: Sequence[tuple[Region, Templates, Templates]]) -> None:
        """Let each cue compute at once what it reads of several regions; see `Cue.precompute`.

        Args:
            predicted_targets: Region, templates and first templates of each target.
        """
        for name, cue in self._cues.items():
            known = [
                PredictedTarget(region, templates[name], first[name])
                for region, templates, first in predicted_targets
                if name in templates
            ]
            if known:
                cue.precompute(known)

    def observe(self, region: Region, box: NDArray[np.float64]) -> Templates:
        """What each cue sees in a (4,) box of the frame at hand; see `Cue.observe`."""
        return {name: cue.observe(region, box) for name, cue in self._cues.items()}

    def log_likelihood(
        self,
        region: Region,
        boxes: NDArray[np.float64],
        templates: Templates,
        cue_weights: CueWeights | None = None,
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X), at most 0, of (N, 4) boxes; source: Li et al. 2007, equation (8).

        `cue_weights` take the place of the configured ones where they are given. A cue that has no
        template yet, because it was switched on while tracking, says nothing.
        """
        fused = np.zeros(len(boxes))
        cue_weights = cue_weights or self.cue_weights
        for name, cue, template in self._known(templates):
            fused += cue_weights[name] * cue.log_likelihood(region, boxes, template)
        return fused

    def log_likelihoods(
        self, region: Region, boxes: NDArray[np.float64], templates: Templates
    ) -> dict[str, NDArray[np.float64]]:
        """Name of each cue that has a template to its (N,) log likelihoods of (N, 4) boxes."""
        return {
            name: cue.log_likelihood(region, boxes, template)
            for name, cue, template in self._known(templates)
        }

    def searches(self, templates: Templates) -> bool:
        """Whether a cue that has a template can look for the target."""
        return any(name in templates for name in self._searchable)

    def responses(
        self, region: Region, boxes: NDArray[np.float64], templates: Templates
    ) -> Responses:
        """Name of each searchable cue to its (N,) strengths at (N, 4) boxes."""
        return {
            name: cue.response(region, boxes, templates[name])
            for name, cue in self._searchable.items()
            if name in templates
        }

    def responses_on_grid(self, region: Region, grid: BoxGrid, templates: Templates) -> Responses:
        """Name of each searchable cue to its (M,) strengths at the boxes of a grid."""
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
        """(M,) log likelihoods of the boxes of a grid, as far as cues know that can be asked there.

        `responses` are those of the searchable cues on that grid, of at least one.
        """
        fused = np.zeros(len(grid.left) * len(grid.top))
        for name, response in responses.items():
            likelihood = self._searchable[name].log_likelihood_of(response, templates[name])
            fused += cue_weights[name] * likelihood
        for name, cue, template in self._known(templates):
            if cue.joins_search:
                fused += cue_weights[name] * cue.log_likelihood_on_grid(region, grid, template)
        return fused

    def adapt(self, distractor_ratios: DistractorRatios, adaptation: float) -> CueWeights:
        """The powers moved to the cues that are distracted less than the mean; they sum to 1."""
        if not distractor_ratios or adaptation == 0.0:
            return self.cue_weights
        mean = sum(distractor_ratios.values()) / len(distractor_ratios)
        cue_weights = {
            name: weight
            * min(
                max(1.0 + adaptation * (mean - distractor_ratios.get(name, mean)), _LEAST_POWER),
                _MOST_POWER,
            )
            for name, weight in self.cue_weights.items()
        }
        total = sum(cue_weights.values())
        return {name: weight / total for name, weight in cue_weights.items()}

    def match(self, seen: Templates, templates: Templates) -> Match:
        """How well the one box that was observed fits, fused by equation (8).

        The powers of the cues that can tell are scaled to a sum of 1; without any it fits. The
        similarity is that of the cues that judge, if there are any.
        """
        matches = [
            (cue.is_discriminative, self.cue_weights[name], match)
            for name, cue, template in self._known(templates)
            if (match := cue.match(seen[name], template))
        ]
        judges = [entry for entry in matches if entry[0]] or matches
        total = sum([weight for _, weight, _ in matches])
        judging = sum([weight for _, weight, _ in judges])
        return Match(
            sum([weight / total * match.log_likelihood for _, weight, match in matches]),
            math.prod([match.similarity ** (weight / judging) for _, weight, match in judges]),
        )

    def log_odds(self, seen: Templates, templates: Templates, first: Templates) -> dict[str, float]:
        """What all cues that can tell say, see `Cue.log_odds`; questions as `cue.question`."""
        return {
            f"{name}.{question}": odds
            for name, cue, template in self._known(templates)
            for question, odds in cue.log_odds(seen[name], template, first[name]).items()
        }

    def update(self, templates: Templates, seen: Templates) -> Templates:
        """The templates moved towards what was observed at a trusted estimate.

        Those of cues of weight 0 stay as they are.

        Source: Li et al. 2007, equations (9) and (10).
        """
        return dict(templates) | {
            name: cue.blend(templates[name], seen[name])
            if name in templates
            else cue.template_from(seen[name])
            for name, cue in self._cues.items()
        }

    def _known(self, templates: Templates) -> list[tuple[str, Cue, Any]]:
        """Name, cue and template of each cue that has one."""
        return [
            (name, cue, templates[name]) for name, cue in self._cues.items() if name in templates
        ]
