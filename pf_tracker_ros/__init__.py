"""Fused-cue particle filter tracking: `Tracker` for images, the ROS 2 node in `node`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pf_tracker_ros.tracking.estimate import Estimate
    from pf_tracker_ros.tracking.tracker import Tracker

__all__ = ["Estimate", "Tracker"]

_MODULES = {"Estimate": "estimate", "Tracker": "tracker"}


def __getattr__(name: str) -> Any:
    # Imported when asked for, so that the executables can take care of signals before NumPy loads.
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.tracking.{_MODULES[name]}"), name)
