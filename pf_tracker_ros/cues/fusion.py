"""Several cues fused into one likelihood, and their templates kept up to date."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import Cue, Match
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.parameters import ParameterError, declared

# One template a cue, in the order of the fused cues.
Templates = tuple[Any, ...]


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
    keep: float = declared(
        0.9,
        "Share of the old template that an update keeps (beta).",
        minimum=0.0,
        maximum=1.0,
    )


class CueFusion:
    """Any number of cues as one: the product of their likelihoods' powers.

    p(Z | X) = prod_k p_k(Z_k | X)^alpha_k with sum_k alpha_k = 1.

    Source: Li et al. 2007, section 2.2.3 and equation (8).

    Args:
        cues: Name to (cue, power); powers of at least 0 are scaled to a sum of 1, and a cue of
            power 0 is left out, so that it costs nothing.

    Raises:
        ParameterError: No power is above 0.
    """

    def __init__(self, cues: Mapping[str, tuple[Cue, float]]) -> None:
        used = {name: entry for name, entry in cues.items() if entry[1] > 0.0}
        if not used:
            names = ", ".join(f"'{name}.power'" for name in cues)
            raise ParameterError(f"all cues are off; at least one of {names} must be above 0")
        total = sum(power for _, power in used.values())
        self.names: Sequence[str] = tuple(used)
        self.powers: Sequence[float] = tuple(power / total for _, power in used.values())
        self._cues = tuple(cue for cue, _ in used.values())

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> Templates:
        """Each cue's template of what is in a (4,) box."""
        return tuple(cue.learn(maps, box) for cue in self._cues)

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], templates: Templates
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X), at most 0, of (N, 4) boxes; source: Li et al. 2007, equation (8)."""
        fused = np.zeros(len(boxes))
        for cue, power, template in zip(self._cues, self.powers, templates, strict=True):
            fused += power * cue.log_likelihood(maps, boxes, template)
        return fused

    def match(self, seen: Templates, templates: Templates) -> Match:
        """How well the one box that `seen` was learned from fits, fused by equation (8)."""
        matches = [
            cue.match(new, template)
            for cue, new, template in zip(self._cues, seen, templates, strict=True)
        ]
        return Match(
            log_likelihood=sum(
                power * match.log_likelihood
                for power, match in zip(self.powers, matches, strict=True)
            ),
            similarity=math.prod(
                match.similarity**power for power, match in zip(self.powers, matches, strict=True)
            ),
        )

    def blend(self, templates: Templates, seen: Templates, keep: float) -> Templates:
        """Each template moved towards what is seen; source: Li et al. 2007, (9) and (10)."""
        return tuple(
            cue.blend(template, new, keep)
            for cue, template, new in zip(self._cues, templates, seen, strict=True)
        )
