"""What can go wrong with a recording's tracking, each with an exit code of its own."""

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
INTERRUPTED = 130
TERMINATED = 143

DISK_IS_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the system's errors for want of room."""
_FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)


class RecordingError(ValueError):
    """Tracking a recording that cannot be done as asked; the message says why.

    Attributes:
        exit_code: Of the command `track`.

    Args:
        message: One sentence.
        exit_code: As the attribute.
    """

    def __init__(self, message: str, exit_code: int = REFUSED) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def unwritable(path: Path, error: OSError) -> RecordingError:
    """The error of a file or folder that the system does not let one write."""
    reason = error.strerror or type(error).__name__
    if error.errno in DISK_IS_FULL:
        return RecordingError(
            f"{path} cannot be written any further ({reason}); make room, or choose another folder",
            DISK_FULL,
        )
    if error.errno in _FORBIDDEN:
        return RecordingError(
            f"{path} may not be written by this user ({reason}); change the permissions of its "
            "folder, or choose another one",
            NO_PERMISSION,
        )
    return RecordingError(f"{path} cannot be written ({reason})", FAILED)
