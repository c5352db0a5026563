"""How much memory the tracking of a recording takes, for who places it on a machine."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.archives.tasks import ArchiveTask
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, read_targets

# Bytes, as measured with images of 0.3 to 8 megapixels: of a worker, and of a pixel of its images.
_WORKER, _PIXEL = 250 * 10**6, 30
# What the other outputs take besides: their libraries, pictures that wait, what is known of frames.
_OUTPUTS, _OUTPUT_PIXEL = 70 * 10**6, 50
_REPORT = 250 * 10**6
# What detections take besides: frames kept for late ones, and SciPy.
_DETECTIONS = 120 * 10**6
# Of what does not tell: more than most have, as nothing runs in what is missing.
_IMAGE_SIZE = (3840, 2160)


def required_memory(task: ArchiveTask) -> int:
    """Bytes that a worker needs for a task, by the size of images that its target file tells.

    The recording itself is not opened: one that is broken is a worker's trouble.
    """
    targets = _targets(task)
    width, height = (targets[0].image_size if targets else None) or _IMAGE_SIZE
    needed = _WORKER + _PIXEL * width * height
    if any(each.startswith("--detect") for each in task.arguments):
        needed += _DETECTIONS
    if {"--video", "--bag", "--report"} & set(task.arguments):
        needed += _OUTPUTS + _OUTPUT_PIXEL * width * height
    return needed + (_REPORT if "--report" in task.arguments else 0)


def _targets(task: ArchiveTask) -> tuple[Target, ...]:
    """The targets of a task's target file, none where there is no such file to read."""
    if is_url(task.source):
        return ()
    source = Path(task.source)
    try:
        return read_targets(target_file(source), source)
    except (RecordingError, OSError):
        return ()
