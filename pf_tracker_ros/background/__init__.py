"""Background subtraction by a ViBe model."""

from pf_tracker_ros.background.vibe import UPDATE_EVERY, BackgroundModel, BackgroundState

__all__ = ["UPDATE_EVERY", "BackgroundModel", "BackgroundState"]
