"""Whether files and folders can be read, told before anything opens them.

Opening a FIFO or a device may block forever, and OpenCV does not tell a file that it may not read
from one that it cannot decode.
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
    """Refuse what is not a regular file that this user may read.

    Args:
        path: The file.
        what: What it should be, for the message, such as `video`.

    Raises:
        FootageError: It is missing, of another kind, or may not be read.
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISREG(mode):
            path.open("rb").close()
            return
    except OSError as error:
        raise unreadable(path, what, error) from error
    kind = next((name for name, applies in _KINDS.items() if applies(mode)), "no file")
    raise FootageError(f"{what} {path} is {kind}; accepted are regular files")


def entries(folder: Path) -> list[Path]:
    """What is in a folder.

    Raises:
        FootageError: It cannot be listed.
    """
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise unreadable(folder, "folder", error) from error


def exists(path: Path) -> bool:
    """Whether there is something at a path, of any kind.

    Raises:
        FootageError: This user may not look there.
    """
    try:
        return path.exists()
    except OSError as error:
        raise unreadable(path, "path", error) from error


def lexists(path: Path) -> bool:
    """Whether there is something at a path, be it a link that leads to nothing.

    Raises:
        FootageError: This user may not look there.
    """
    return exists(path) or path.is_symlink()


def is_folder(path: Path) -> bool:
    """Whether a path is a folder, as far as this user may look; what cannot be one is none."""
    try:
        return path.is_dir()
    except OSError:
        return False


def resolved(path: Path) -> Path:
    """The absolute path without links in it, but for such as lead in a circle, to nowhere."""
    return Path(os.path.realpath(path))


def unreadable(path: Path, what: str, error: OSError) -> FootageError:
    """The error of a file or folder that the system does not let one read."""
    reason = error.strerror or type(error).__name__
    if isinstance(error, PermissionError):
        return FootageError(
            f"{what} {path} may not be read by this user ({reason}); change its permissions, those "
            "of the folders above it, or the user"
        )
    return FootageError(f"{what} {path} cannot be read ({reason})")
