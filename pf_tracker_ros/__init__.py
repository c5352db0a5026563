"""Fused-cue particle filter tracking: `Tracker` for images, the ROS 2 node in `node`."""

from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.tracker import Tracker

__all__ = ["Estimate", "Tracker"]
