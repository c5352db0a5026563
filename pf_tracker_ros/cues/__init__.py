"""Cues: the measurement model p(Z | X), which compares the image in a box with a template.

1. A cue learns a template from the first box (`Cue.learn`).
2. In each frame it computes the log likelihood of the boxes of all particles (`log_likelihood`).
   Some cues can also search a whole grid of boxes (`SearchableCue`).
3. `CueFusion` adds the log likelihoods of all cues, multiplied by the cue weights.
4. When the estimate is trusted, the template is blended with what was observed there (`blend`).

`pf_tracker_ros.tracking.measurement` applies the cues to the particles.
"""

from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, SearchableCue
from pf_tracker_ros.cues.fusion import CueFusion, FusionParameters, TemplateParameters
from pf_tracker_ros.registry import import_all

__all__ = [
    "CUES",
    "Cue",
    "CueFusion",
    "CueParameters",
    "FusionParameters",
    "Match",
    "SearchableCue",
    "TemplateParameters",
]

import_all(__name__, __path__)
