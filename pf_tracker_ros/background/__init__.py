"""What of the image is background: a ViBe model, and the camera's motion to carry it along."""

from pf_tracker_ros.background.camera_motion import CameraMotion
from pf_tracker_ros.background.vibe import (
    UPDATE_EVERY,
    BackgroundModel,
    BackgroundParameters,
    BackgroundState,
)

__all__ = [
    "UPDATE_EVERY",
    "BackgroundModel",
    "BackgroundParameters",
    "BackgroundState",
    "CameraMotion",
]
