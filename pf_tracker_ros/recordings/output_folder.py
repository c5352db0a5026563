"""The files of one recording in its folder: put in place whole, or up to where the work ended."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from pf_tracker_ros.atomic_files import flush_to_disk, hidden_folder, move_without_overwriting
from pf_tracker_ros.recordings.errors import OUTPUT_EXISTS, RecordingError, unwritable
from pf_tracker_ros.recordings.tracking import TrackedFrame


class FrameWriter(Protocol):
    """Writes what is known after each frame."""

    def write(self, tracked: TrackedFrame) -> None:
        """Write one frame."""
        ...

    def close(self) -> None:
        """Finish the file, which then is whole."""
        ...

    def discard(self) -> None:
        """Give the file up, unfinished, and all that it takes to write it."""
        ...


WriterFactory = Callable[[Path], FrameWriter]
"""Begins a file at a path where nothing is yet."""


class OutputFolder:
    """Writes files side by side in a hidden folder, from where they go into place when closed.

    Args:
        folder: Where they go; made where it is missing.
        makers: Name of each file to what begins it.

    Raises:
        RecordingError: A file is there already, or cannot be written.
    """

    def __init__(self, folder: Path, makers: dict[str, WriterFactory]) -> None:
        self._folder = folder
        check_free(folder, makers)
        self._writers: dict[str, FrameWriter] = {}
        self._made = ExitStack()
        try:
            for each in reversed([folder, *folder.parents]):
                if not each.exists():
                    each.mkdir(exist_ok=True)
                    self._made.callback(_remove_empty, each)
            self._workplace = self._made.enter_context(hidden_folder(folder, ".track_"))
            for name, make in makers.items():
                self._writers[name] = make(self._workplace / name)
        except OSError as error:
            self.discard()
            raise unwritable(folder, error) from error
        except BaseException:
            self.discard()
            raise

    def write(self, tracked: TrackedFrame) -> None:
        """Write a frame into every file.

        Raises:
            RecordingError: One cannot be written any further.
        """
        for name, writer in self._writers.items():
            try:
                writer.write(tracked)
            except OSError as error:
                raise unwritable(self._folder / name, error) from error

    def close(self) -> list[RecordingError]:
        """Finish the files and put those that are whole into place.

        Returns:
            Why others are not.
        """
        failures: dict[str, RecordingError] = {}
        for name, writer in self._writers.items():
            place = self._folder / name
            try:
                writer.close()
                flush_to_disk(self._workplace / name)
                move_without_overwriting(self._workplace / name, place)
            except FileExistsError:
                failures[name] = _exists(place)
            except OSError as error:
                failures[name] = unwritable(place, error)
            except RecordingError as error:
                failures[name] = error
        self._writers = {}
        self.discard()
        return list(failures.values())

    def discard(self) -> None:
        """Leave nothing but what was put into place."""
        for writer in self._writers.values():
            # What it is about is being given up already.
            with contextlib.suppress(Exception):
                writer.discard()
        self._writers = {}
        self._made.close()


def check_free(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder where files are already, or where there can be none.

    Raises:
        RecordingError: One is there, or it is no folder.
    """
    try:
        if os.path.lexists(folder) and not folder.is_dir():
            raise RecordingError(
                f"{folder} is no folder; give another one to write into", OUTPUT_EXISTS
            )
        for name in names:
            if os.path.lexists(folder / name):
                raise _exists(folder / name)
    except OSError as error:
        raise unwritable(folder, error) from error


def _exists(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} exists already and is left as it is; remove it or give another folder",
        OUTPUT_EXISTS,
    )


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()
