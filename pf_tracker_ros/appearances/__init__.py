"""Appearances: descriptors that identify targets over a long time.

A cue's template adapts in every frame, also to an occluder. A descriptor is extracted only from
confirmed detections and changes slowly, so it can re-identify a target after minutes.
"""

from pf_tracker_ros.appearances.appearance import (
    APPEARANCES,
    Appearance,
    AppearanceParameters,
    Descriptor,
    build_appearance,
)
from pf_tracker_ros.registry import import_all

__all__ = [
    "APPEARANCES",
    "Appearance",
    "AppearanceParameters",
    "Descriptor",
    "build_appearance",
]

import_all(__name__, __path__)
