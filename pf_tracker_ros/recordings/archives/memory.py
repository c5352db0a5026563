"""How much memory the tracking of a recording takes, for who places it on a machine."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.archives.tasks import ArchiveTask
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.target import read_targets, target_file

# Bytes, as measured with images of 0.3 to 8 megapixels: of a worker, and of a pixel of its images.
_WORKER, _PIXEL = 250 * 10**6, 30
# What the other outputs take besides: their libraries, pictures that wait, what is known of frames.
_OUTPUTS, _OUTPUT_PIXEL = 70 * 10**6, 50
_REPORT = 250 * 10**6
# Of what does not tell: more than most have, as nothing runs in what is missing.
_IMAGE_SIZE = (3840, 2160)


def needed_memory(task: ArchiveTask) -> int:
    """Bytes that a worker needs for a task, by the size of images that its target file tells.

    The recording itself is not opened: one that is broken is a worker's trouble.
    """
    width, height = _image_size(task)
    needed = _WORKER + _PIXEL * width * height
    if {"--video", "--bag", "--report"} & set(task.arguments):
        needed += _OUTPUTS + _OUTPUT_PIXEL * width * height
    return needed + (_REPORT if "--report" in task.arguments else 0)


def _image_size(task: ArchiveTask) -> tuple[int, int]:
    if is_url(task.source):
        return _IMAGE_SIZE
    source = Path(task.source)
    try:
        return read_targets(target_file(source), source)[0].image_size or _IMAGE_SIZE
    except (RecordingError, OSError):
        return _IMAGE_SIZE
