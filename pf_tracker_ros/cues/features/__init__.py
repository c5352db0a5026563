"""Features of image windows, one value per channel and cell, for the correlation filter."""

from pf_tracker_ros.cues.features.features import FEATURES, Calibration, Features
from pf_tracker_ros.registry import import_all

__all__ = ["FEATURES", "Calibration", "Features"]

import_all(__name__, __path__)
