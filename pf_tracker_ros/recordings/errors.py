"""Errors of tracking a recording, and the exit codes of `track`."""

from __future__ import annotations

import errno
from pathlib import Path

DONE = 0
FAILED = 1
REFUSED = 2
UNREADABLE_SOURCE = 3
OUTPUT_EXISTS = 4
NO_PERMISSION = 5
DISK_FULL = 6
WRONG_TARGET = 7
WRONG_DETECTIONS = 8
FILES_KEPT = 9
INTERRUPTED = 130
TERMINATED = 143

DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of a full disk."""
_PERMISSION_ERRNOS = (errno.EACCES, errno.EPERM, errno.EROFS)


class RecordingError(ValueError):
    """A recording cannot be tracked as requested.

    Attributes:
        exit_code: Of the command `track`.

    Args:
        message: What is wrong, and what would be right.
        exit_code: As the attribute.
    """

    def __init__(self, message: str, exit_code: int = REFUSED) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def unwritable(path: Path, error: OSError) -> RecordingError:
    """Return the error for a file or folder that cannot be written."""
    message = f"{path} cannot be written ({error.strerror or type(error).__name__})"
    if error.errno in DISK_FULL_ERRNOS:
        return RecordingError(f"{message}; free disk space, or choose another folder", DISK_FULL)
    if error.errno in _PERMISSION_ERRNOS:
        advice = "change the permissions of its folder, or choose another folder"
        return RecordingError(f"{message}; {advice}", NO_PERMISSION)
    return RecordingError(message, FAILED)
