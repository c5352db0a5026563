"""Siamese cue: agreement of a box with the boxes that a small network finds.

1. The network compares a crop around the predicted box with the target's first box. It returns a
   box for each cell of the crop, with the probability s_i that it is the target.
2. The response of a box X is that of the candidate that is most like it:

       r(X) = max_i s_i exp(-d_i(X)^2 / 2)

   d_i is the distance of the center, in box sides, and of the logarithms of width and height, each
   in its standard deviation. The log likelihood falls linearly with the response.
3. A share of the particles is moved to the candidates (`Search.propose_boxes`).
4. Low log odds of the candidate at the estimate lower the confidence.

The weight of the cue grows with the doubt about the last estimate: where the other cues are sure of
it, they have the better box; where they are not, the network often still knows the target. It also
grows with the network's reliability on this target: its usual log odds at estimates without a
doubt. The network runs at most once a frame for each target, around its predicted box; elsewhere
the cue is silent. Its template is that of the first box, so it cannot drift.

Sources: see `networks.siamese`; Okuma et al. 2004, "A boosted particle filter: multitarget
detection and tracking" (particles at detections).
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis, BoxGrid
from pf_tracker_ros.cues.cue import (
    CUES,
    CueParameters,
    Match,
    NetworkUse,
    PredictedTarget,
    SearchableCue,
    declared_weight,
)
from pf_tracker_ros.filter import ProposedBoxes
from pf_tracker_ros.frames import Region
from pf_tracker_ros.parameters import declared

if TYPE_CHECKING:
    from pf_tracker_ros.networks.siamese import Candidates, NetworkTemplate

# Likeliest candidates that are compared with boxes.
_COMPARED = 12
# Standard deviations of a candidate's center, box sides, and of the logarithms of its sides.
_CENTER_STD, _SIZE_STD = 0.35, 0.6
# How fast the log likelihood falls with the response: in the most doubt, where the other cues are
# about as sharp, a candidate outweighs them.
_SHARPNESS = 400.0
# The log odds of a candidate at the estimate count against the target below the usual ones of the
# target or, if those are higher, below the second value, down to the first, by this slope. Higher
# ones add nothing: distractors have them, too.
_LEAST_ODDS, _USUAL_ODDS, _ODDS_SLOPE = -3.0, 2.0, 0.5
# Usual log odds up to which a network is not believed, and from which on it is. A little remains,
# so that it goes on looking.
_UNRELIABLE_ODDS, _RELIABLE_ODDS, _LEAST_RELIABILITY = 0.8, 1.6, 0.001
# Least share of a new look in the usual log odds; looks at a new target that wait for no doubt.
_USUAL_RATE, _FIRST_LOOKS = 0.05, 20


@dataclass(frozen=True)
class SiameseParameters(CueParameters):
    """The Siamese cue."""

    weight: float = declared_weight(1.0)
    model: str = declared(
        "",
        "Folder of the network, or the path of its description; see docs/learned.md.",
        read_only=True,
    )
    when: str = declared(
        "always",
        "When the network runs. always: in every frame; doubtful: while the confidence is below "
        "0.6, for less CPU time.",
        choices=("always", "doubtful"),
    )


@dataclass(frozen=True, eq=False)
class SiameseTemplate:
    """The network's template of a target, and how well the network has known it so far.

    Attributes:
        network: Of the first box.
        usual_odds: Smoothed log odds of the candidate at estimates without a doubt.
        looks: Number of such estimates.
        fits: Whether the network is made for such images.
    """

    network: NetworkTemplate
    usual_odds: float
    looks: int = 0
    fits: bool = True


class _Look(NamedTuple):
    """What the network found in a region, and the doubt about the last estimate."""

    candidates: Candidates
    doubt: float


class SiameseObservation(NamedTuple):
    """The box of an observation, and its region, which holds what the network found.

    Attributes:
        region: Region of the frame.
        box: (4,) x, y, width, height in pixels.
    """

    region: Region
    box: NDArray[np.float64]


@CUES.register("siamese", SiameseParameters)
class Siamese(SearchableCue):
    """Agreement with the candidates of a Siamese network.

    Args:
        parameters: Network, and when it runs.

    Raises:
        ParameterError: The network cannot be used; the message says why.
    """

    proposes = True
    weighs_in_doubt = True

    def __init__(self, parameters: SiameseParameters) -> None:
        # Imported here: nothing but this cue needs it.
        from pf_tracker_ros.networks.described import open_network
        from pf_tracker_ros.networks.siamese import SiameseNetwork

        self._network = open_network(SiameseNetwork, parameters.model)
        self._has_told = False
        self._use = NetworkUse()
        self._only_in_doubt = parameters.when == "doubtful"

    @property
    def network_use(self) -> NetworkUse:
        """See `Cue.network_use`; without what a new target takes."""
        return self._use

    def learn(self, region: Region, box: NDArray[np.float64]) -> SiameseTemplate:
        """See `Cue.learn`."""
        template = self._network.learn(region.frame, box)
        candidates = self._network.find(region.frame, template, box)
        usual_odds = max(_odds_among(candidates, box), _LEAST_ODDS)
        fits = self._network.fits(region.frame, box)
        return SiameseTemplate(template, usual_odds, fits=fits)

    def reliability(self, template: SiameseTemplate) -> float:
        """See `Cue.reliability`: it grows with the usual log odds of the target."""
        if not template.fits:
            return 0.0
        above = (template.usual_odds - _UNRELIABLE_ODDS) / (_RELIABLE_ODDS - _UNRELIABLE_ODDS)
        return min(max(above, _LEAST_RELIABILITY), 1.0)

    def observe(self, region: Region, box: NDArray[np.float64]) -> SiameseObservation:
        """See `Cue.observe`."""
        return SiameseObservation(region, box)

    def template_from(self, observation: SiameseObservation) -> SiameseTemplate:
        """See `Cue.template_from`."""
        return self.learn(observation.region, observation.box)

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """See `Cue.precompute`; without it, or where no cell has a box, the cue is silent."""
        for one in predicted_targets:
            is_new = one.template.looks < _FIRST_LOOKS
            if one.doubt > 0.0 or is_new or not self._only_in_doubt:
                region = one.region
                start = time.perf_counter()
                found = self._network.find(region.frame, one.template.network, region.center_box)
                seconds = self._use.seconds + time.perf_counter() - start
                self._use = NetworkUse(self._use.runs + 1, seconds)
                if len(found.boxes):
                    region.store(_key(one.template), _Look(found.likeliest(_COMPARED), one.doubt))
                elif not self._has_told:
                    self._has_told = True
                    logging.getLogger(__name__).warning(
                        "the network %s gives no usable box in a frame; its cue is left out of "
                        "such frames (told once)",
                        self._network.description.name,
                    )

    def responds(self, region: Region, template: SiameseTemplate) -> bool:
        """See `SearchableCue.responds`."""
        return _found(region, template) is not None

    def response(
        self, region: Region, boxes: NDArray[np.float64], template: SiameseTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response`; 0 where the cue is silent."""
        return self._response(region, BoxesByAxis(*boxes.T), template, _SIZE_STD)

    def response_on_grid(
        self, region: Region, grid: BoxGrid, template: SiameseTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response_on_grid`; the size is left out, as all have the same."""
        return self._response(region, grid.by_axis, template, math.inf)

    def _response(
        self, region: Region, boxes: BoxesByAxis, template: SiameseTemplate, size_std: float
    ) -> NDArray[np.float64]:
        found = _found(region, template)
        shape = np.broadcast(*boxes).shape
        if found is None:
            return np.zeros(math.prod(shape))
        probabilities = found.probabilities.reshape(-1, *[1] * len(shape))
        likeness = np.exp(_log_likeness(found.boxes, boxes, size_std))
        responses: NDArray[np.float64] = probabilities * likeness
        return responses.max(axis=0).ravel()

    def log_likelihood_of(
        self, response: NDArray[np.float64], template: SiameseTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return -_SHARPNESS * (1.0 - response)

    def propose(self, region: Region, template: SiameseTemplate) -> ProposedBoxes | None:
        """See `Cue.propose`."""
        found = _found(region, template)
        if found is None:
            return None
        return ProposedBoxes(found.boxes, found.probabilities * self.reliability(template))

    def match(self, observation: SiameseObservation, template: SiameseTemplate) -> Match | None:
        """See `Cue.match`; the other cues decide what is learned."""
        return None

    def log_odds(
        self, observation: SiameseObservation, template: SiameseTemplate, first: SiameseTemplate
    ) -> dict[str, float]:
        """See `Cue.log_odds`."""
        odds = _odds_at(observation, template)
        if odds is None:
            return {}
        missing = max(odds, _LEAST_ODDS) - min(template.usual_odds, _USUAL_ODDS)
        return {"score": _ODDS_SLOPE * self.reliability(template) * min(missing, 0.0)}

    def recognition(self, observation: SiameseObservation, template: SiameseTemplate) -> float:
        """See `Cue.recognition`: the probability of the candidate there."""
        odds = _odds_at(observation, template)
        return 0.0 if odds is None else 0.5 * (1.0 + math.tanh(odds / 2))

    def blend(self, template: SiameseTemplate, observation: SiameseObservation) -> SiameseTemplate:
        """See `Cue.blend`; the network's template stays, and only its usual log odds change."""
        look = _look(observation.region, template)
        if look is None or look.doubt > 0.0:
            return template
        odds = max(_odds_among(look.candidates, observation.box), _LEAST_ODDS)
        looks = template.looks + 1
        # The mean of the first looks; the first frame is too easy to count.
        rate = max(_USUAL_RATE, 1.0 / looks)
        usual_odds = template.usual_odds + rate * (odds - template.usual_odds)
        return replace(template, usual_odds=usual_odds, looks=looks)


def _odds_at(observation: SiameseObservation, template: SiameseTemplate) -> float | None:
    """Log odds of the best candidate at the observed box; None where the cue is silent."""
    found = _found(observation.region, template)
    return None if found is None else _odds_among(found, observation.box)


def _odds_among(candidates: Candidates, box: NDArray[np.float64]) -> float:
    """Log odds of the best candidate at a (4,) box; minus infinity without any."""
    log_likeness = _log_likeness(candidates.boxes, BoxesByAxis(*box), _SIZE_STD)
    return float((candidates.log_odds + log_likeness).max(initial=-math.inf))


def _log_likeness(
    candidates: NDArray[np.float64], boxes: BoxesByAxis, size_std: float
) -> NDArray[np.float64]:
    """(K, ...) logarithm of the likeness, 0 to 1, of boxes to (K, 4) candidates.

    Args:
        candidates: Boxes of the network, pixels.
        boxes: The boxes, pixels.
        size_std: Standard deviation of the logarithms of the sides.
    """
    x, y, width, height = boxes
    dimensions = np.broadcast(*boxes).ndim
    left, top, widths, heights = (values.reshape(-1, *[1] * dimensions) for values in candidates.T)
    across = (x + width / 2 - left - widths / 2) / (_CENTER_STD * width)
    down = (y + height / 2 - top - heights / 2) / (_CENTER_STD * height)
    wider = np.log(width / widths) / size_std
    higher = np.log(height / heights) / size_std
    squared = np.square(across) + np.square(down) + np.square(wider) + np.square(higher)
    log_likeness: NDArray[np.float64] = -0.5 * squared
    return log_likeness


def _found(region: Region, template: SiameseTemplate) -> Candidates | None:
    """What the network found in a region; None where it did not run."""
    look = _look(region, template)
    return None if look is None else look.candidates


def _look(region: Region, template: SiameseTemplate) -> _Look | None:
    look: _Look | None = region.cached(_key(template), lambda: None)
    return look


def _key(template: SiameseTemplate) -> object:
    """Key of a look in a region's cache."""
    return "siamese candidates", template
