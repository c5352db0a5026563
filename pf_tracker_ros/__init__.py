"""Fused-cue particle filter tracking: `Tracker` for images, the ROS 2 node in `node`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pf_tracker_ros.targets.detections import Detections
    from pf_tracker_ros.targets.multi_tracker import MultiTracker
    from pf_tracker_ros.targets.tracked_target import TrackedTarget
    from pf_tracker_ros.targets.tracker import Tracker
    from pf_tracker_ros.tracking.estimate import Estimate

    __version__: str

__all__ = [
    "Detections",
    "Estimate",
    "MultiTracker",
    "TrackedTarget",
    "Tracker",
    "__version__",
]

_MODULES = {
    "Detections": "targets.detections",
    "Estimate": "tracking.estimate",
    "MultiTracker": "targets.multi_tracker",
    "TrackedTarget": "targets.tracked_target",
    "Tracker": "targets.tracker",
}


def __getattr__(name: str) -> Any:
    # Imported on first access, so that the executables can handle signals before NumPy loads.
    if name == "__version__":
        return _version()
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        # Without an installation, the manifest is beside the package.
        from pathlib import Path
        from xml.etree import ElementTree

        manifest = Path(__file__).resolve().parent.parent / "package.xml"
        return ElementTree.parse(manifest).findtext("version", "")
