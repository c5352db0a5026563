"""Siamese cue: agreement of a box with the boxes that a small network finds.

1. The network compares a crop around the predicted box with the target's first box. It returns a
   box for each cell of the crop, with the probability s_i that it is the target.
2. The response of a box X is that of the candidate that is most like it:

       r(X) = max_i s_i exp(-d_i(X)^2 / 2)

   d_i is the distance of the center, in box sides, and of the logarithms of width and height, each
   in its standard deviation. For a small target, differences of a few pixels are none: the network
   sees magnified pixels, and the other cues have the better box. The log likelihood falls linearly
   with the response.
3. A share of the particles is moved to the candidates (`Search.propose_boxes`).
4. Low log odds of the candidate at the estimate lower the confidence. High ones confirm a target
   that has been followed all along, until there is a rival (`assessment.recognition_odds`). Boxes
   elsewhere in the crop, which a redetection may find, are judged by the same candidates.

The weight of the cue grows with the doubt about the last estimate: where the other cues are sure of
it, they have the better box; where they are not, the network often still knows the target. The
network runs at most once a frame for each target, around its predicted box; elsewhere the cue is
silent and has no weight. Its template is that of the first box, so it cannot drift. A network for
color images is not used on gray ones, unless no other cue is selected.

Sources: see `networks.siamese`; Okuma et al. 2004, "A boosted particle filter: multitarget
detection and tracking" (particles at detections).
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis, BoxGrid, relative_center_distances
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
# Difference of centers and sides that counts as none for a target of up to the second value, pixels
# of the frame; there is no such difference from twice that size on.
_TOLERANCE, _SMALL = 6.0, 32.0
# Distance from the middle of the crop, box sides, within which the network sees a box whole.
_SEEN_WITHIN = 2.0
# How fast the log likelihood falls with the response: in the most doubt, where the other cues are
# about as sharp, a candidate outweighs them.
_SHARPNESS = 400.0
# The log odds of a candidate at the estimate count against the target below the second value, down
# to the first, by this slope. Higher ones add nothing here: distractors have them, too.
_LEAST_ODDS, _USUAL_ODDS, _ODDS_SLOPE = -3.0, 2.0, 0.5


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
        "When the network runs. always: in every frame; doubtful: while the confidence, without "
        "what it recognizes, is below 0.85, for less CPU time.",
        choices=("always", "doubtful"),
    )


@dataclass(frozen=True, eq=False)
class SiameseTemplate:
    """The network's template of a target.

    Attributes:
        network: Of the first box.
        suits: Whether the network is meant for such images.
    """

    network: NetworkTemplate
    suits: bool


class _Found(NamedTuple):
    """What the network found in a frame, and the (4,) box around which it did, pixels."""

    candidates: Candidates
    center_box: NDArray[np.float64]


class SiameseObservation(NamedTuple):
    """The box of an observation, and its region, whose frame holds what the network found.

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
        frame = region.frame
        return SiameseTemplate(self._network.learn(frame, box), self._network.suits(frame, box))

    def suits(self, template: SiameseTemplate) -> bool:
        """See `Cue.suits`."""
        return template.suits

    def observe(self, region: Region, box: NDArray[np.float64]) -> SiameseObservation:
        """See `Cue.observe`."""
        return SiameseObservation(region, box)

    def template_from(self, observation: SiameseObservation) -> SiameseTemplate:
        """See `Cue.template_from`."""
        return self.learn(observation.region, observation.box)

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """See `Cue.precompute`; without it, or where no cell has a box, the cue is silent."""
        for one in predicted_targets:
            region, likeliest = one.region, None
            if one.doubt > 0.0 or not self._only_in_doubt:
                start = time.perf_counter()
                found = self._network.find(region.frame, one.template.network, region.center_box)
                seconds = self._use.seconds + time.perf_counter() - start
                self._use = NetworkUse(self._use.runs + 1, seconds)
                if len(found.boxes):
                    likeliest = _Found(found.likeliest(_COMPARED), region.center_box)
                elif not self._has_told:
                    self._has_told = True
                    logging.getLogger(__name__).warning(
                        "the network %s gives no usable box in a frame; its cue is left out of "
                        "such frames (told once)",
                        self._network.description.name,
                    )
            region.frame.store(_key(one.template), likeliest)

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
        return None if found is None else ProposedBoxes(found.boxes, found.probabilities)

    def match(self, observation: SiameseObservation, template: SiameseTemplate) -> Match | None:
        """See `Cue.match`; the other cues decide what is learned."""
        return None

    def log_odds(
        self, observation: SiameseObservation, template: SiameseTemplate
    ) -> dict[str, float]:
        """See `Cue.log_odds`."""
        odds = _odds_at(observation, template)
        if odds is None:
            return {}
        return {"score": _ODDS_SLOPE * (min(max(odds, _LEAST_ODDS), _USUAL_ODDS) - _USUAL_ODDS)}

    def recognition(self, observation: SiameseObservation, template: SiameseTemplate) -> float:
        """See `Cue.recognition`: the probability of the candidate there."""
        odds = _odds_at(observation, template)
        return 0.0 if odds is None else 0.5 * (1.0 + math.tanh(odds / 2))

    def blend(self, template: SiameseTemplate, observation: SiameseObservation) -> SiameseTemplate:
        """See `Cue.blend`; the template stays."""
        return template


def _odds_at(observation: SiameseObservation, template: SiameseTemplate) -> float | None:
    """Log odds of the best candidate at the observed box; None where the network sees none."""
    stored, box = _found_in_frame(observation.region, template), observation.box
    if stored is None or relative_center_distances(box, stored.center_box) > _SEEN_WITHIN:
        return None
    found = stored.candidates
    log_likeness = _log_likeness(found.boxes, BoxesByAxis(*box), _SIZE_STD)
    return float((found.log_odds + log_likeness).max())


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
    size = np.sqrt(width * height)
    tolerance = _TOLERANCE * np.clip(2.0 - size / _SMALL, 0.0, 1.0)
    across = np.abs(x + width / 2 - left - widths / 2) - tolerance
    down = np.abs(y + height / 2 - top - heights / 2) - tolerance
    wider = np.abs(np.log(width / widths)) - tolerance / width
    higher = np.abs(np.log(height / heights)) - tolerance / height
    across, down = across / (_CENTER_STD * width), down / (_CENTER_STD * height)
    squared = np.zeros(np.broadcast(across, down).shape)
    for difference in (across, down, wider / size_std, higher / size_std):
        squared += np.square(np.maximum(difference, 0.0))
    log_likeness: NDArray[np.float64] = -0.5 * squared
    return log_likeness


def _found(region: Region, template: SiameseTemplate) -> Candidates | None:
    """What the network found in a region; None where it did not run."""
    stored = _found_in_frame(region, template)
    if stored is None or stored.center_box is not region.center_box:
        return None
    return stored.candidates


def _found_in_frame(region: Region, template: SiameseTemplate) -> _Found | None:
    """What the network found anywhere in the frame of a region; None where it did not run."""
    stored: _Found | None = region.frame.cached(_key(template), lambda: None)
    return stored


def _key(template: SiameseTemplate) -> object:
    """Key of the candidates in a frame's cache."""
    return "siamese candidates", template
