"""An image of the camera, and what is made of it: once for all who look at it."""

from pf_tracker_ros.frames.frame import Foreground, Frame
from pf_tracker_ros.frames.region import Region

__all__ = ["Foreground", "Frame", "Region"]
