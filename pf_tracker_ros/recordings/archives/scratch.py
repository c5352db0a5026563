"""Scratch folders: those that a killed process leaves behind go with the next one."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pf_tracker_ros.recordings.errors import unwritable

_PREFIX = "pf_tracker_ros_"


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder below the system's temporary one (`TMPDIR`), gone afterwards.

    Those of processes that have ended without removing theirs are removed first.

    Raises:
        RecordingError: It cannot be made.
    """
    _remove_abandoned()
    try:
        folder, lock = _locked_folder()
    except OSError as error:
        raise unwritable(Path(tempfile.gettempdir()), error) from error
    try:
        yield folder.resolve()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked_folder() -> tuple[Path, int]:
    """A new folder, and the lock on it that ends with this process, however that ends."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
        # Before it has its lock, another process may take it for an abandoned one and remove it.
        with suppress(FileNotFoundError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            with suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if folder.exists():
                    return folder, lock
            os.close(lock)


def _remove_abandoned() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        # Those of other users stay, and those that are in use are locked.
        with suppress(OSError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
