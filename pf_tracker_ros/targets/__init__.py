"""Multi-target tracking around the particle filter of one target (`tracking.target_filter`).

`MultiTracker` and `Tracker` are the entry points; both use a `TrackManager`. A `TrackSet` holds all
tracks after a frame and is immutable. `TrackingPipeline` computes the next one:

1. The associator assigns detections to tracks.
2. The updater runs the filter of each track and corrects it with its detection.
3. The deleter ends tracks, the initiator starts new ones, and re-identification restores lost ids.

Here as everywhere, boxes are (x, y, width, height) and sizes (width, height), in pixels. Intervals
and ages are in seconds, stamps in nanoseconds. Of N tracks, the N assigned detections are None
where a track has none.
"""

from pf_tracker_ros.opencv import require_opencv

require_opencv()
