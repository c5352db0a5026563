"""Scratch folders in the temporary folder. Each new one removes those of killed processes."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pf_tracker_ros.recordings.errors import unwritable

_PREFIX = "pf_tracker_ros_scratch_"
# With random digits, so that no other folder has such a name.
_NAME = re.compile(re.escape(_PREFIX) + r"[0-9a-f]{16}_[a-z0-9_]{8}")


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield a folder in the system's temporary folder (`TMPDIR`), and remove it afterwards.

    Folders of killed processes are removed first.

    Raises:
        RecordingError: It cannot be created.
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
    """A new folder and its lock, which the system releases when this process ends."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{secrets.token_hex(8)}_"))
        # Another process may remove it as abandoned before it is locked.
        with suppress(FileNotFoundError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            with suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if folder.exists():
                    return folder, lock
            os.close(lock)


def _remove_abandoned() -> None:
    found = Path(tempfile.gettempdir()).glob(f"{_PREFIX}*")
    for folder in [each for each in found if _NAME.fullmatch(each.name)]:
        # Folders of other users and locked folders stay.
        with suppress(OSError):
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
