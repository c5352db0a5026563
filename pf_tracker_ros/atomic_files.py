"""Atomic file writes: write a draft on the same file system, flush it, rename it into place.

A reader sees the former file or the complete new one, also after a crash.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Errors of file systems without hard links.
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EMLINK, errno.ENOSYS)


@contextmanager
def atomic_write(
    path: Path, *, may_replace: bool = True, prefix: str = ".draft_"
) -> Iterator[Path]:
    """Write a draft of a file, and move it into place when the block ends without an error.

    Args:
        path: The file. A symbolic link is followed.
        may_replace: Whether to replace an existing file.
        prefix: Name prefix of the hidden folder beside the file, which holds the draft.

    Yields:
        Path of the draft, with the file's own name.

    Raises:
        OSError: The file cannot be written, or exists and may not be replaced.
    """
    destination = Path(os.path.realpath(path)) if may_replace else path
    if (
        may_replace
        and os.path.lexists(destination)
        and (destination.is_symlink() or not destination.is_file())
    ):
        raise FileExistsError(errno.EEXIST, "Exists and is not a regular file", str(path))
    with hidden_folder(destination.parent, prefix) as folder:
        draft = folder / destination.name
        yield draft
        flush_to_disk(draft)
        if may_replace:
            draft.replace(destination)
        else:
            move_without_overwriting(draft, destination)


@contextmanager
def hidden_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """Temporary folder inside `parent`, and so on the same file system.

    Raises:
        OSError: The folder cannot be made.
    """
    folder = tempfile.mkdtemp(prefix=prefix, dir=parent)
    try:
        yield Path(folder)
    finally:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            # A signal may have interrupted the first attempt.
            shutil.rmtree(folder, ignore_errors=True)


def move_without_overwriting(path: Path, destination: Path) -> None:
    """Move a file; an existing destination stays.

    Raises:
        OSError: The destination exists or cannot be written.
    """
    try:
        # Unlike a rename, a hard link never replaces a file.
        os.link(path, destination)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if os.path.lexists(destination):
            raise FileExistsError(destination) from error
        path.rename(destination)


def flush_to_disk(path: Path) -> None:
    """Write a closed file through to the disk, so that it survives a power failure.

    Raises:
        OSError: It cannot be written.
    """
    with path.open("rb") as file:
        os.fsync(file.fileno())
