"""Camera images and the maps computed from them, each once, shared by all targets and cues."""

from pf_tracker_ros.frames.frame import Foreground, Frame, check_image
from pf_tracker_ros.frames.region import Region

__all__ = ["Foreground", "Frame", "Region", "check_image"]
