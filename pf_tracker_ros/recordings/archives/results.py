"""Where the results of an archive go: whole or not at all, whatever is killed on the way.

In a folder each recording's files come into place together, by the renaming of a folder. In an
object store each is put there, which is atomic by itself, and `done.json` last: what lacks it is
not done. Only results are replaced, and nothing else that stands in their place.
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
# Hidden, so that nobody takes what is in it for results. A run removes those that a killed one has
# left; `track` on a single recording, which may be at work below, calls its own otherwise.
_WORKPLACE = ".archive_"
# In a store it stands beside what may be replaced although `done.json` is missing.
_UNFINISHED = ".track_unfinished"
# An object comes there whole or not at all; of other stores that fsspec knows not all promise it.
_OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss")


def results_at(place: PathOrUrl) -> Results:
    """The results at a folder or the URL of an object store.

    Raises:
        RecordingError: Results cannot go there.
    """
    if not is_url(place):
        return ResultsFolder(Path(place).absolute())
    scheme = str(place).partition("://")[0].lower()
    if scheme not in _OBJECT_STORES:
        raise RecordingError(
            f"results cannot go to {scheme}://; allowed: a folder, {', '.join(_OBJECT_STORES)}"
        )
    return ResultsStore(str(place))


@dataclass(frozen=True)
class ResultsFolder:
    """Results in a folder, which all workers must share.

    Attributes:
        path: Of the folder, absolute.
        run: Stands for the run that is at work there, and in its lock file; empty before it is.
    """

    path: Path
    run: str = ""

    @property
    def name(self) -> str:
        """As it is told."""
        return str(self.path)

    @contextmanager
    def locked(self) -> Iterator[ResultsFolder]:
        """Keep other runs out, and leave nothing there that is under way.

        Yields:
            What is to be used meanwhile, by workers too.

        Raises:
            RecordingError: Another run is at work there, or nothing can be written there.
        """
        run = secrets.token_hex(8)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = (self.path / LOCK).open("a")
        except OSError as error:
            raise unwritable(self.path, error) from error
        with lock:
            try:
                # The system gives it up with the process, however that ends.
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
        """Name to text of those files, relative, that are there and can be read."""
        found = {}
        for name in names:
            try:
                found[name] = (self.path / name).read_text(encoding="utf-8")
            except (OSError, ValueError):
                continue
        return found

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A folder to make the files of a recording in; what is left in it is removed.

        Raises:
            RecordingError: It cannot be made, or in the recording's place is what are no results.
        """
        self._check_run()
        self._check_place(recording)
        folder = self.path / recording
        with ExitStack() as stack:
            try:
                folder.parent.mkdir(parents=True, exist_ok=True)
                made = stack.enter_context(hidden_folder(folder.parent, _WORKPLACE))
            except OSError as error:
                raise unwritable(folder, error) from error
            yield made

    def put(self, made: Path, recording: str) -> None:
        """Put a folder that was made in a workplace in the place of the recording's.

        Raises:
            RecordingError: It cannot be put there, or in its place is what are no results.
        """
        folder = self.path / recording
        # Workers may outlive their driver for a moment, until after the next one has begun.
        self._check_run()
        self._check_place(recording)
        try:
            if os.path.lexists(folder):
                folder.replace(made.with_name(f"{made.name}_before"))
            made.replace(folder)
        except OSError as error:
            raise unwritable(folder, error) from error

    def put_text(self, text: str, name: str) -> None:
        """Put one file in place, whole.

        Raises:
            RecordingError: It cannot be written.
        """
        path = self.path / name
        try:
            with atomic_write(path, prefix=_WORKPLACE) as draft:
                draft.write_text(text, encoding="utf-8", errors="replace")
        except OSError as error:
            raise unwritable(path, error) from error

    def _check_run(self) -> None:
        found = self.read([LOCK]).get(LOCK)
        if found is None:
            raise RecordingError(
                f"{self.path} of {platform.node()} is another folder than that of the run; give "
                "one that all machines share, or an object store",
                FAILED,
            )
        if found != self.run:
            raise RecordingError(f"another run has taken over {self.path}", FAILED)

    def _check_place(self, recording: str) -> None:
        """Refuse to replace anything but results and empty folders."""
        folder, done = self.path / recording, f"{recording}/{DONE_FILE}"
        if not os.path.lexists(folder) or _is_of_results(self.read([done]).get(done, "")):
            return
        try:
            is_free = folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir())
        except OSError as error:
            raise unwritable(folder, error) from error
        if not is_free:
            raise _taken(str(folder))

    def _clean_up(self) -> None:
        for path in self.path.rglob(f"{_WORKPLACE}*"):
            shutil.rmtree(path, ignore_errors=True)


@dataclass(frozen=True)
class ResultsStore:
    """Results in an object store. It has no locks: two runs at once do the same work twice.

    Attributes:
        url: Of what stands for a folder there.
    """

    url: str

    @property
    def name(self) -> str:
        """As it is told."""
        return self.url

    @contextmanager
    def locked(self) -> Iterator[ResultsStore]:
        """Find out whether anything can be written there; see `ResultsFolder.locked`."""
        self.put_text("", LOCK)
        yield self

    def read(self, names: Sequence[str]) -> dict[str, str]:
        """Name to text of the objects that are there; see `ResultsFolder.read`.

        Raises:
            FootageError: Nothing can be read there.
        """
        found = {}
        with translate_read_errors(self.url):
            store, root = open_store(self.url)
            # Of all its methods to read several this one takes names as they are, without patterns.
            contents = store.cat_ranges([f"{root}/{name}" for name in names], None, None)
            for name, content in zip(names, contents, strict=True):
                if isinstance(content, bytes):
                    found[name] = content.decode("utf-8", "replace")
                elif not isinstance(content, FileNotFoundError):
                    raise content
        return found

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A folder on this machine; see `ResultsFolder.staging_folder`."""
        self._replaceable(recording)
        with scratch_folder() as folder:
            yield folder

    def put(self, made: Path, recording: str) -> None:
        """Put the objects there one by one, `done.json` last; see `ResultsFolder.put`."""
        before = self._replaceable(recording)
        files = sorted(
            (path for path in made.rglob("*") if path.is_file()),
            key=lambda path: path.name == DONE_FILE,
        )
        with translate_write_errors(f"{self.url}/{recording}"):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            unfinished = f"{folder}/{_UNFINISHED}"
            store.pipe_file(unfinished, b"")
            # First that of an earlier run goes which says that all is there.
            for name in sorted(before, key=lambda name: not name.endswith(f"/{DONE_FILE}")):
                if not name.endswith(f"/{_UNFINISHED}"):
                    store.rm_file(name)
            for file in files:
                store.put_file(str(file), f"{folder}/{file.relative_to(made).as_posix()}")
            store.rm_file(unfinished)

    def put_text(self, text: str, name: str) -> None:
        """Put an object there; see `ResultsFolder.put_text`."""
        with translate_write_errors(f"{self.url}/{name}"):
            store, root = open_store(self.url)
            store.pipe_file(f"{root}/{name}", text.encode("utf-8", "replace"))

    def _replaceable(self, recording: str) -> list[str]:
        """The objects in the place of a recording's results; refuses them if they are no results.

        Raises:
            RecordingError: They are no results, or cannot be looked at.
        """
        place = f"{self.url}/{recording}"
        with translate_write_errors(place):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            names: list[str] = store.find(folder)
            if not names or f"{folder}/{_UNFINISHED}" in names:
                return names
            done = f"{folder}/{DONE_FILE}"
            if done in names and _is_of_results(store.cat_file(done).decode("utf-8", "replace")):
                return names
        raise _taken(place)


Results = ResultsFolder | ResultsStore
"""Where results go. Workers, on other machines too, are given copies of it."""


def _is_of_results(text: str) -> bool:
    """Whether this is in the `done.json` of results, of whichever run and version."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and {"name", "source", "key"} <= document.keys()


def _taken(place: str) -> RecordingError:
    return RecordingError(
        f"{place} exists already, is not of a recording's results, and is left as it is; move it, "
        "or give another output",
        OUTPUT_EXISTS,
    )
