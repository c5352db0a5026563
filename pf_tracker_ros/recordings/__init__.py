"""Tracks targets through recordings without ROS: bags, videos, folders of images and sequences.

recording = open_recording("drive.mcap")
for tracked in track_recording(recording, choose_target(recording, (293, 97, 115, 82))):
    print(tracked.frame.stamp, tracked.state, tracked.box)
"""

from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame, Recording, open_recording
from pf_tracker_ros.recordings.target import Target, choose_target, choose_targets
from pf_tracker_ros.recordings.tracking import TrackedFrame, track_recording

__all__ = [
    "RecordedFrame",
    "Recording",
    "RecordingError",
    "Target",
    "TrackedFrame",
    "choose_target",
    "choose_targets",
    "open_recording",
    "track_recording",
]
