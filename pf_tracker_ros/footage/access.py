"""Checks that files and folders can be read, made before they are opened.

Opening a FIFO or a device may block forever, and OpenCV reports a missing permission as a decoding
error.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

from pf_tracker_ros.footage.base import FootageError

_KINDS: dict[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a FIFO": stat.S_ISFIFO,
    "a socket": stat.S_ISSOCK,
    "a device": lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
}


def check_file(path: Path, what: str) -> None:
    """Check that a path is a readable regular file.

    Args:
        path: The file.
        what: Kind of file for messages, such as `video`.

    Raises:
        FootageError: It is missing, not a regular file, or not readable.
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISREG(mode):
            path.open("rb").close()
            return
    except OSError as error:
        raise unreadable(path, what, error) from error
    except ValueError as error:
        raise FootageError(f"{what} {str(path)!r} is no path of a file ({error})") from error
    kind = next((name for name, is_kind in _KINDS.items() if is_kind(mode)), "no file")
    raise FootageError(f"{what} {path} is {kind}; accepted are regular files")


def read_file(path: Path, what: str, max_bytes: int) -> bytes:
    """The content of a regular file.

    Args:
        path: The file.
        what: Kind of file for messages.
        max_bytes: Largest size.

    Raises:
        FootageError: As for `check_file`, or it is larger.
    """
    check_file(path, what)
    try:
        with path.open("rb") as file:
            # The size of a file of the system, as in /proc, is unknown before.
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise unreadable(path, what, error) from error
    if len(content) > max_bytes:
        raise FootageError(f"{what} {path} is larger than {max_bytes} bytes, the most allowed")
    return content


def entries(folder: Path) -> list[Path]:
    """Entries of a folder.

    Raises:
        FootageError: It cannot be listed.
    """
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise unreadable(folder, "folder", error) from error


def exists(path: Path) -> bool:
    """Whether a path exists, following links.

    Raises:
        FootageError: A parent folder is not accessible.
    """
    try:
        return path.exists()
    except OSError as error:
        raise unreadable(path, "path", error) from error


def lexists(path: Path) -> bool:
    """Whether a path exists, also as a broken link.

    Raises:
        FootageError: A parent folder is not accessible.
    """
    return exists(path) or path.is_symlink()


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; False also if a parent folder is not accessible."""
    try:
        return path.is_dir()
    except OSError:
        return False


def resolved(path: Path) -> Path:
    """The absolute path with links resolved, except those in a loop."""
    return Path(os.path.realpath(path))


def unreadable(path: Path, what: str, error: OSError) -> FootageError:
    """The FootageError for a file or folder that raised an OSError."""
    reason = error.strerror or type(error).__name__
    if isinstance(error, PermissionError):
        return FootageError(
            f"{what} {path} may not be read by this user ({reason}); change its permissions or "
            "those of the folders above it"
        )
    return FootageError(f"{what} {path} cannot be read ({reason})")
