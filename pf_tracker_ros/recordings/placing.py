"""Puts files where nothing is yet."""

from __future__ import annotations

import errno
import os
from pathlib import Path

# What file systems without hard links answer.
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EMLINK, errno.ENOSYS)


def put_in_place(path: Path, place: Path) -> None:
    """Move a file to where nothing is yet; what has come there meanwhile stays.

    Raises:
        OSError: There is something, or it may not be moved there.
    """
    try:
        # Unlike a renaming, a link replaces nothing.
        os.link(path, place)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if os.path.lexists(place):
            raise FileExistsError(place) from error
        path.rename(place)
