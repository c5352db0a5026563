"""Cues: what a box in the image looks like, compared with a template of the target."""

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
