"""The memory that a task needs, for placement on the machines of a cluster."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.stamp_order import WINDOW
from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.archives.tasks import ArchiveTask
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.plan import uses_detector
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, read_targets

# Bytes of a worker and of a pixel of its images, measured with images of 0.3 to 8 megapixels, and
# of the images of a bag that wait to be sorted.
_WORKER, _PIXEL = 250 * 10**6, 30 + 3 * WINDOW
# Further outputs: their libraries, queued images and frame summaries.
_OUTPUTS, _OUTPUT_PIXEL = 70 * 10**6, 50
_REPORT = 250 * 10**6
# Detections: the frame buffer for late ones, and SciPy.
_DETECTIONS = 120 * 10**6
# Assumed if unknown; rather too large, because a task fails with too little memory.
_DEFAULT_IMAGE_SIZE = (3840, 2160)


def required_memory(task: ArchiveTask) -> int:
    """Bytes that a worker needs for a task, from the image size in its target file.

    The recording itself is not opened, so a broken one fails in its worker.
    """
    targets = _targets(task)
    width, height = (targets[0].image_size if targets else None) or _DEFAULT_IMAGE_SIZE
    needed = _WORKER + _PIXEL * width * height
    has_report = task.options.report is not None
    if uses_detector(task.options):
        needed += _DETECTIONS
    if task.options.video or task.options.bag or has_report:
        needed += _OUTPUTS + _OUTPUT_PIXEL * width * height
    return needed + (_REPORT if has_report else 0)


def _targets(task: ArchiveTask) -> tuple[Target, ...]:
    """The targets in a task's target file; empty if it cannot be read."""
    if is_url(task.source):
        return ()
    source = Path(task.source)
    try:
        return read_targets(target_file(source), source)
    except (RecordingError, OSError):
        return ()
