"""Storage of the results of an archive. The results of a recording appear atomically.

- In a folder, all files of a recording are written to a hidden folder, which is then renamed.
- In an object store, each object is written atomically, and `done.json` last. Results without it
  are incomplete.

A killed process leaves no incomplete results. Only results are replaced, never other files.
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pf_tracker_ros.atomic_files import atomic_write, hidden_folder
from pf_tracker_ros.recordings.archives.scratch import scratch_folder
from pf_tracker_ros.recordings.archives.sources import PathOrUrl
from pf_tracker_ros.recordings.archives.stores import (
    is_url,
    open_store,
    translate_read_errors,
    translate_write_errors,
)
from pf_tracker_ros.recordings.errors import FAILED, OUTPUT_EXISTS, RecordingError, unwritable

DONE_FILE = "done.json"
LOCK = ".lock"
# Hidden staging folders. A run removes those of a killed run, but not those of `track` on a single
# recording, which have another prefix.
_STAGING_PREFIX = ".archive_"
# Marks objects in a store that may be replaced although `done.json` is missing.
_UNFINISHED = ".track_unfinished"
# Stores that write objects atomically. Not all of fsspec's others do.
_OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss")


def results_at(path_or_url: PathOrUrl) -> Results:
    """The results in a folder or at the URL of an object store.

    Raises:
        RecordingError: The store is not supported.
    """
    if not is_url(path_or_url):
        return ResultsFolder(Path(path_or_url).absolute())
    scheme = str(path_or_url).partition("://")[0].lower()
    if scheme not in _OBJECT_STORES:
        raise RecordingError(
            f"results cannot be written to {scheme}://; allowed: a folder, "
            f"{', '.join(f'{each}://' for each in _OBJECT_STORES)}"
        )
    return ResultsStore(str(path_or_url))


@dataclass(frozen=True)
class ResultsFolder:
    """Results in a folder, which all workers must share.

    Attributes:
        path: Of the folder, absolute.
        run: Random id of the run that holds the lock, also in the lock file; empty before.
    """

    path: Path
    run: str = ""

    @property
    def name(self) -> str:
        """For messages."""
        return str(self.path)

    @contextmanager
    def locked(self) -> Iterator[ResultsFolder]:
        """Lock the folder against other runs, and remove incomplete results.

        Yields:
            The results to use while locked, in workers too.

        Raises:
            RecordingError: Another run holds the lock, or the folder cannot be written.
        """
        run = secrets.token_hex(8)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = (self.path / LOCK).open("a")
        except OSError as error:
            raise unwritable(self.path, error) from error
        with lock:
            try:
                # The system releases it when the process ends, however that happens.
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise RecordingError(
                    f"another run is writing into {self.path}; wait for it, or give another folder",
                    OUTPUT_EXISTS,
                ) from error
            try:
                lock.truncate(0)
                lock.write(run)
                lock.flush()
            except OSError as error:
                raise unwritable(self.path / LOCK, error) from error
            self._clean_up()
            try:
                yield replace(self, run=run)
            finally:
                self._clean_up()

    def read(self, names: Sequence[str]) -> dict[str, str]:
        """Relative name to text, of the files that can be read."""
        found = {}
        for name in names:
            try:
                found[name] = (self.path / name).read_text(encoding="utf-8")
            except (OSError, ValueError):
                continue
        return found

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A temporary folder to write the files of a recording in.

        Raises:
            RecordingError: It cannot be created, or other files are in the recording's folder.
        """
        self._check_run()
        self._check_replaceable(recording)
        folder = self.path / recording
        with ExitStack() as stack:
            try:
                folder.parent.mkdir(parents=True, exist_ok=True)
                staging = stack.enter_context(hidden_folder(folder.parent, _STAGING_PREFIX))
            except OSError as error:
                raise unwritable(folder, error) from error
            yield staging

    def put(self, staged: Path, recording: str) -> None:
        """Replace the results of a recording by a folder in its staging folder.

        Raises:
            RecordingError: It cannot be moved, or other files are in the recording's folder.
        """
        folder = self.path / recording
        # A worker may outlive its driver, and meet the next run.
        self._check_run()
        self._check_replaceable(recording)
        try:
            if os.path.lexists(folder):
                folder.replace(staged.with_name(f"{staged.name}_before"))
            staged.replace(folder)
        except OSError as error:
            raise unwritable(folder, error) from error

    def put_text(self, text: str, name: str) -> None:
        """Write a text file atomically.

        Raises:
            RecordingError: It cannot be written.
        """
        path = self.path / name
        try:
            with atomic_write(path, prefix=_STAGING_PREFIX) as draft:
                draft.write_text(text, encoding="utf-8", errors="replace")
        except OSError as error:
            raise unwritable(path, error) from error

    def _check_run(self) -> None:
        found = self.read([LOCK]).get(LOCK)
        if found is None:
            raise RecordingError(
                f"{self.path} on {platform.node()} is not the folder of the run; give a folder "
                "that all machines share, or an object store",
                FAILED,
            )
        if found != self.run:
            raise RecordingError(f"another run is writing into {self.path} now", FAILED)

    def _check_replaceable(self, recording: str) -> None:
        """Refuse to replace anything but results and empty folders."""
        folder, done = self.path / recording, f"{recording}/{DONE_FILE}"
        if not os.path.lexists(folder) or _is_done_json(self.read([done]).get(done, "")):
            return
        try:
            is_empty = folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir())
        except OSError as error:
            raise unwritable(folder, error) from error
        if not is_empty:
            raise _not_results_error(str(folder))

    def _clean_up(self) -> None:
        for path in self.path.rglob(f"{_STAGING_PREFIX}*"):
            shutil.rmtree(path, ignore_errors=True)


@dataclass(frozen=True)
class ResultsStore:
    """Results in an object store. Without locks: two runs at once do the same work twice.

    Attributes:
        url: Of the folder.
    """

    url: str

    @property
    def name(self) -> str:
        """For messages."""
        return self.url

    @contextmanager
    def locked(self) -> Iterator[ResultsStore]:
        """Check write access; see `ResultsFolder.locked`."""
        self.put_text("", LOCK)
        yield self

    def read(self, names: Sequence[str]) -> dict[str, str]:
        """Read objects; see `ResultsFolder.read`.

        Raises:
            FootageError: The store cannot be read.
        """
        found = {}
        with translate_read_errors(self.url):
            store, root = open_store(self.url)
            # The only method that reads several objects without expanding patterns in names.
            contents = store.cat_ranges([f"{root}/{name}" for name in names], None, None)
            for name, content in zip(names, contents, strict=True):
                if isinstance(content, bytes):
                    found[name] = content.decode("utf-8", "replace")
                elif not isinstance(content, FileNotFoundError):
                    raise content
        return found

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A temporary folder on this machine; see `ResultsFolder.staging_folder`."""
        self._replaceable_objects(recording)
        with scratch_folder() as folder:
            yield folder

    def put(self, staged: Path, recording: str) -> None:
        """Write the objects one by one, `done.json` last; see `ResultsFolder.put`."""
        before = self._replaceable_objects(recording)
        files = sorted(
            (path for path in staged.rglob("*") if path.is_file()),
            key=lambda path: path.name == DONE_FILE,
        )
        with translate_write_errors(f"{self.url}/{recording}"):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            unfinished = f"{folder}/{_UNFINISHED}"
            store.pipe_file(unfinished, b"")
            # The former `done.json` is removed first.
            for name in sorted(before, key=lambda name: not name.endswith(f"/{DONE_FILE}")):
                if not name.endswith(f"/{_UNFINISHED}"):
                    store.rm_file(name)
            for file in files:
                store.put_file(str(file), f"{folder}/{file.relative_to(staged).as_posix()}")
            store.rm_file(unfinished)

    def put_text(self, text: str, name: str) -> None:
        """Write an object; see `ResultsFolder.put_text`."""
        with translate_write_errors(f"{self.url}/{name}"):
            store, root = open_store(self.url)
            store.pipe_file(f"{root}/{name}", text.encode("utf-8", "replace"))

    def _replaceable_objects(self, recording: str) -> list[str]:
        """The objects in the folder of a recording's results.

        Raises:
            RecordingError: They are not results, or cannot be read.
        """
        url = f"{self.url}/{recording}"
        with translate_write_errors(url):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            names: list[str] = store.find(folder)
            if not names or f"{folder}/{_UNFINISHED}" in names:
                return names
            done = f"{folder}/{DONE_FILE}"
            if done in names and _is_done_json(store.cat_file(done).decode("utf-8", "replace")):
                return names
        raise _not_results_error(url)


Results = ResultsFolder | ResultsStore
"""Storage of results. Workers, on other machines too, receive copies."""


def _is_done_json(text: str) -> bool:
    """Whether this is the text of a `done.json`, of any run and version."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and {"name", "source", "key"} <= document.keys()


def _not_results_error(path_or_url: str) -> RecordingError:
    return RecordingError(
        f"{path_or_url} exists already, holds no results, and is not overwritten; move it, or give "
        "another output",
        OUTPUT_EXISTS,
    )
