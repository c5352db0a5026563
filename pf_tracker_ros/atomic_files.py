"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# What file systems without hard links answer.
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EMLINK, errno.ENOSYS)


@contextmanager
def atomic_write(
    path: Path, *, may_replace: bool = True, prefix: str = ".draft_"
) -> Iterator[Path]:
    """Write a file elsewhere first; it comes into place when the block ends without an error.

    Args:
        path: The file; of a link, what it leads to.
        may_replace: Whether a file that is there may be replaced; else it stays.
        prefix: Of the hidden folder beside it that the draft is in.

    Yields:
        Where to write it, under its own name.

    Raises:
        OSError: It cannot be written, or what is there may not be replaced.
    """
    place = Path(os.path.realpath(path)) if may_replace else path
    if may_replace and os.path.lexists(place) and (place.is_symlink() or not place.is_file()):
        raise FileExistsError(errno.EEXIST, "It is no file that can be written over", str(path))
    with hidden_folder(place.parent, prefix) as folder:
        draft = folder / place.name
        yield draft
        flush_to_disk(draft)
        if may_replace:
            draft.replace(place)
        else:
            move_without_overwriting(draft, place)


@contextmanager
def hidden_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """A folder of its own inside another one, and so on the same file system; gone afterwards.

    Raises:
        OSError: It cannot be made.
    """
    folder = tempfile.mkdtemp(prefix=prefix, dir=parent)
    try:
        yield Path(folder)
    finally:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            # A signal that ends the process may have come in the middle of it.
            shutil.rmtree(folder, ignore_errors=True)


def move_without_overwriting(path: Path, place: Path) -> None:
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


def flush_to_disk(path: Path) -> None:
    """Let a file that is closed outlast a loss of power.

    Raises:
        OSError: It cannot be written.
    """
    with path.open("rb") as file:
        os.fsync(file.fileno())
