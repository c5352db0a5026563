"""The filter of one target: particle filter and cues, track states, presets and parameters.

A step takes the `FilterState` after the last frame, the next `Frame` and the interval between them,
seconds. Boxes are (x, y, width, height) and sizes (width, height), in pixels.
"""

from pf_tracker_ros.opencv import require_opencv

require_opencv()
