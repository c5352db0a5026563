"""Several cues fused into one likelihood, and their templates kept up to date."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import Cue, Match
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.parameters import ParameterError, declared

# Name of a cue to its template.
Templates = Mapping[str, Any]


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
    confident_above: float = declared(
        0.0,
        "No template is updated unless the confidence is at least this.",
        minimum=0.0,
        maximum=1.0,
    )
    judge_by_first: bool = declared(
        False,
        "Judge the confidence by the templates of the first frame instead of the last, so that "
        "what was learned by mistake can't vouch for itself.",
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
        # Those that need the place are asked last; sorting keeps the order of the others.
        in_order = sorted(used.items(), key=lambda item: item[1][0].needs_place)
        self._cues = {name: cue for name, (cue, _) in in_order}
        self.powers: Mapping[str, float] = {
            name: power / total for name, (_, power) in used.items()
        }

    @property
    def reach(self) -> float:
        """How far beyond each side of a box the cues look at most, in box sides."""
        return max(cue.reach for cue in self._cues.values())

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> Templates:
        """Each cue's template of what is in a (4,) box."""
        return {name: cue.learn(maps, box) for name, cue in self._cues.items()}

    def observe(self, maps: FrameMaps, box: NDArray[np.float64]) -> Templates:
        """What each cue sees in a (4,) box of the frame at hand; see `Cue.observe`."""
        return {name: cue.observe(maps, box) for name, cue in self._cues.items()}

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], templates: Templates
    ) -> NDArray[np.float64]:
        """(N,) log p(Z | X), at most 0, of (N, 4) boxes; source: Li et al. 2007, equation (8).

        A cue that has no template yet, because it was switched on while tracking, says nothing.
        """
        fused = np.zeros(len(boxes))
        for name, template in self._known(templates):
            cue, power = self._cues[name], self.powers[name]
            if cue.needs_place:
                weights = np.exp(fused - fused.max())
                maps.place = weights @ boxes / weights.sum()
            fused += power * cue.log_likelihood(maps, boxes, template)
        return fused

    def match(self, seen: Templates, templates: Templates) -> Match:
        """How well the one box that was observed fits, fused by equation (8).

        The powers of the cues that can tell are scaled to a sum of 1; without any it fits.
        """
        matches = [
            (self.powers[name], match)
            for name, template in self._known(templates)
            if (match := self._cues[name].match(seen[name], template))
        ]
        total = sum(power for power, _ in matches)
        log_likelihood, similarity = 0.0, 1.0
        for power, match in matches:
            log_likelihood += power / total * match.log_likelihood
            similarity *= match.similarity ** (power / total)
        return Match(log_likelihood, similarity)

    def updated(
        self, templates: Templates, seen: Templates, trusted: bool, keep: float
    ) -> Templates:
        """The templates after a frame in which the target was tracked.

        Args:
            templates: Of the frames before.
            seen: Observed at the estimate.
            trusted: Whether the fused likelihood of the estimate exceeded w_Th.
            keep: Share of the old templates that a trusted frame keeps (beta).

        Returns:
            Templates moved towards what was seen; source: Li et al. 2007, (9) and (10).
        """
        updated = dict(templates)
        for name, cue in self._cues.items():
            if name not in templates:
                updated[name] = cue.adopt(seen[name])
            elif cue.steady_keep is not None:
                updated[name] = cue.blend(templates[name], seen[name], cue.steady_keep)
            elif trusted:
                updated[name] = cue.blend(templates[name], seen[name], keep)
        return updated

    def judged_by(self, templates: Templates, first: Templates) -> Templates:
        """The templates of the first frame, but the last ones of cues that follow every frame.

        Those tell the target from its surroundings, which the first frame knows nothing of.
        """
        return {
            name: first[name] if self._cues[name].steady_keep is None and name in first else last
            for name, last in self._known(templates)
        }

    def _known(self, templates: Templates) -> list[tuple[str, Any]]:
        return [(name, templates[name]) for name in self._cues if name in templates]
