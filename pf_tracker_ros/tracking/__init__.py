"""The tracker: particle filter and cues put together, with presets and track states."""

from pf_tracker_ros.opencv import require_opencv

require_opencv()
