"""Appearances: what is in a box, described so that targets can be told apart over a long time.

A cue's template follows its target from frame to frame, and takes in what hides it. A descriptor is
made of what a detector has confirmed, and changes slowly.
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
