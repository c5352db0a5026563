"""The filter of one target: particle filter and cues, track states, presets and parameters."""

from pf_tracker_ros.opencv import require_opencv

require_opencv()
