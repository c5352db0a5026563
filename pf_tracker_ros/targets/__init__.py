"""Several targets: the roles that start, tell apart, correct and end them, each in a file.

`MultiTracker` is the face. A `TrackSet` is all targets after a frame, a value, and `TrackingPipeline` makes
the next one of it: the associator gives each detection to a target, the updater follows and
corrects every target, the initiator starts new ones, the deleter ends old ones.
"""

from pf_tracker_ros.opencv import require_opencv

require_opencv()
