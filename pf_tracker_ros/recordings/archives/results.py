"""Storage of the results of an archive. The results of a recording appear atomically.

- In a folder, all files of a recording are written to a hidden folder, which is then renamed.
- In an object store, each object is written atomically, and `done.json` last. Results without it
  are incomplete.

A killed process leaves no incomplete results. `done.json` has the SHA-256 of each file. Only files
with the recorded hash are replaced or removed. Those that were added or changed since stay.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import platform
import re
import secrets
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pf_tracker_ros.atomic_files import atomic_write
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import read_file
from pf_tracker_ros.recordings.archives.file_records import (
    FileRecord,
    file_hashes,
    hash_of,
    is_own_file,
    parse_record,
    record_text,
)
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
# Hashes of the files beside the folders of the recordings, such as the manifest.
_RECORD = ".track_files.json"
_OWN_LOCK = re.compile(r"[0-9a-f]{16}|")
# Hidden staging folders. A run removes those of a killed run, but not those of `track` on a single
# recording, which have another prefix.
_STAGING_PREFIX = ".archive_"
_STAGING_NAME = re.compile(re.escape(_STAGING_PREFIX) + r"[0-9a-f]{16}_[a-z0-9_]{8}")
# The folder in a staging folder that holds the former results until the new ones are in place.
_BEFORE = "before"
# The record of the objects in a store that may be replaced although `done.json` is missing.
_UNFINISHED = ".track_unfinished"
# Bytes of a text that is read back.
_MAX_TEXT = 100 * 10**6
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
            self._check_own_texts()
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
            with contextlib.suppress(FootageError, ValueError):
                found[name] = read_file(self.path / name, "file", _MAX_TEXT).decode()
        return found

    def complete(self, files: Mapping[str, Collection[str]]) -> set[str]:
        """The recordings with all of their files, given the names of the files of each."""
        return {
            recording
            for recording, names in files.items()
            if all(os.path.lexists(self.path / recording / name) for name in names)
        }

    def kept_files(self, recording: str) -> list[str]:
        """Names in the recording's folder that were added or changed since; they are not replaced.

        Raises:
            RecordingError: The folder holds no results, or cannot be read.
        """
        folder = self.path / recording
        _check_results(folder)
        if not _has_results(folder):
            return []
        done = f"{recording}/{DONE_FILE}"
        record = parse_record(self.read([done]).get(done, ""), done=True) or {}
        try:
            names = sorted(each.name for each in folder.iterdir())
            return [
                name
                for name in names
                if name != DONE_FILE and not is_own_file(folder / name, record)
            ]
        except OSError as error:
            raise unwritable(folder, error) from error

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A temporary folder to write the files of a recording in.

        Raises:
            RecordingError: It cannot be created, or the recording's folder holds no results.
        """
        self._check_run()
        folder = self.path / recording
        _check_results(folder)
        prefix = f"{_STAGING_PREFIX}{self.run}_"
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            staging = Path(tempfile.mkdtemp(prefix=prefix, dir=folder.parent))
        except OSError as error:
            raise unwritable(folder, error) from error
        try:
            yield staging
        finally:
            try:
                _discard(staging)
            finally:
                # A signal may have interrupted the first attempt.
                _discard(staging)

    def put(self, staged: Path, recording: str, kept: Sequence[str] = ()) -> None:
        """Replace the results of a recording by a folder in its staging folder.

        Args:
            staged: The new results.
            recording: Its name.
            kept: What `kept_files` has returned. These stay, also in place of new files.

        Raises:
            RecordingError: It cannot be moved, the recording's folder holds no results, or its
                files have changed since.
        """
        folder = self.path / recording
        before = staged.parent / _BEFORE / folder.name
        # A worker may outlive its driver, and meet the next run.
        self._check_run()
        try:
            state = _state(folder)
            if self.kept_files(recording) != list(kept):
                raise _changed_error(folder)
            for name in kept:
                _link(folder / name, staged / name)
            if os.path.lexists(folder):
                before.parent.mkdir()
                folder.replace(before)
                if _state(before) != state:
                    raise _changed_error(folder)
            staged.replace(folder)
        except OSError as error:
            raise unwritable(folder, error) from error

    def put_text(self, text: str, name: str) -> bool:
        """Write a text file atomically.

        Returns:
            Whether it was written; False if another file of this name stays in its place.

        Raises:
            RecordingError: It cannot be written.
        """
        path, content = self.path / name, text.encode("utf-8", "replace")
        record = parse_record(self.read([_RECORD]).get(_RECORD, "")) or {}
        try:
            if os.path.lexists(path) and not is_own_file(path, record):
                return False
            # The hash of the former text stays until the new one is in place.
            record = {**record, name: {*record.get(name, ()), hash_of(content)}}
            self._write(record_text(record), _RECORD)
            self._write(content, name)
            self._write(record_text({**record, name: {hash_of(content)}}), _RECORD)
        except OSError as error:
            raise unwritable(path, error) from error
        return True

    def _write(self, content: bytes, name: str) -> None:
        with atomic_write(self.path / name, prefix=f"{_STAGING_PREFIX}{self.run}_") as draft:
            draft.write_bytes(content)

    def _check_own_texts(self) -> None:
        """Refuse to write over the lock or record of another program."""
        for name in (LOCK, _RECORD):
            if os.path.lexists(self.path / name) and (
                (self.path / name).is_symlink() or not _is_own_text(name, self.read([name]))
            ):
                raise _not_own_error(str(self.path / name))

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

    def _clean_up(self) -> None:
        for path in [*self.path.rglob(f"{_STAGING_PREFIX}*")]:
            if _STAGING_NAME.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
                _discard(path)


def _check_results(folder: Path) -> None:
    """Refuse to replace anything but results and empty folders; does not read their files."""
    if not os.path.lexists(folder):
        return
    try:
        is_folder = folder.is_dir() and not folder.is_symlink()
        is_empty = is_folder and not any(folder.iterdir())
    except OSError as error:
        raise unwritable(folder, error) from error
    if not (is_empty or (is_folder and _has_results(folder))):
        raise _not_results_error(str(folder))


def _has_results(folder: Path) -> bool:
    try:
        text = read_file(folder / DONE_FILE, "file", _MAX_TEXT).decode()
    except (FootageError, ValueError):
        return False
    return parse_record(text, done=True) is not None


def _discard(staging: Path) -> None:
    """Remove a staging folder; former results without new ones in their place are put back."""
    with contextlib.suppress(OSError):
        before = staging / _BEFORE
        for folder in before.iterdir() if before.is_dir() else ():
            place = staging.parent / folder.name
            if not os.path.lexists(place):
                folder.rename(place)
            elif not _has_results(place):
                # Another program's folder: the former results stay hidden until it is gone.
                return
        shutil.rmtree(staging, ignore_errors=True)


def _state(folder: Path) -> list[tuple[str, int, int, int]]:
    """What changes with any file below a folder: name, inode, size and time of each."""
    found = []
    for parent, _, names in os.walk(folder):
        for name in names:
            path = Path(parent, name)
            status = path.lstat()
            found.append(
                (
                    path.relative_to(folder).as_posix(),
                    status.st_ino,
                    status.st_size,
                    status.st_mtime_ns,
                )
            )
    return sorted(found)


def _link(source: Path, target: Path) -> None:
    """Make a second name of a file, or a folder of such; a copy where the system has no links."""
    if source.is_dir() and not source.is_symlink():
        shutil.copytree(source, target, symlinks=True, copy_function=_link_file)
        return
    target.unlink(missing_ok=True)
    _link_file(source, target)


def _link_file(source: Path | str, target: Path | str) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, target, follow_symlinks=False)


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
        found = self.read([LOCK, _RECORD])
        for name in found:
            if not _is_own_text(name, found):
                raise _not_own_error(f"{self.url}/{name}")
        self._write(b"", LOCK)
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

    def complete(self, files: Mapping[str, Collection[str]]) -> set[str]:
        """The recordings with all of their objects; see `ResultsFolder.complete`.

        Raises:
            FootageError: The store cannot be read.
        """
        if not files:
            return set()
        with translate_read_errors(self.url):
            store, root = open_store(self.url)
            there = set(store.find(root))
        return {
            recording
            for recording, names in files.items()
            if all(f"{root}/{recording}/{name}" in there for name in names)
        }

    def kept_files(self, recording: str) -> list[str]:
        """Objects that were added or changed since; see `ResultsFolder.kept_files`."""
        return self._objects(recording)[1]

    @contextmanager
    def staging_folder(self, recording: str) -> Iterator[Path]:
        """A temporary folder on this machine; see `ResultsFolder.staging_folder`."""
        self._record(recording)
        with scratch_folder() as folder:
            yield folder

    def put(self, staged: Path, recording: str, kept: Sequence[str] = ()) -> None:
        """Write the objects one by one, `done.json` last; see `ResultsFolder.put`."""
        own, kept_now, record = self._objects(recording)
        if kept_now != list(kept):
            raise _changed_error(f"{self.url}/{recording}")
        files = sorted(
            (path for path in staged.rglob("*") if path.is_file()),
            key=lambda path: path.name == DONE_FILE,
        )
        for name, sha256 in file_hashes(staged).items():
            record[name] = {*record.get(name, ()), sha256}
        with translate_write_errors(f"{self.url}/{recording}"):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            unfinished = f"{folder}/{_UNFINISHED}"
            store.pipe_file(unfinished, record_text(record))
            # The former `done.json` is removed first.
            for name in sorted(own, key=lambda name: name != DONE_FILE):
                store.rm_file(f"{folder}/{name}")
            for file in files:
                if (name := file.relative_to(staged).as_posix()) not in kept:
                    store.put_file(str(file), f"{folder}/{name}")
            store.rm_file(unfinished)

    def put_text(self, text: str, name: str) -> bool:
        """Write an object; see `ResultsFolder.put_text`."""
        found, content = self.read([name, _RECORD]), text.encode("utf-8", "replace")
        record = parse_record(found.get(_RECORD, "")) or {}
        if name in found and hash_of(found[name].encode()) not in record.get(name, ()):
            return False
        record = {**record, name: {*record.get(name, ()), hash_of(content)}}
        self._write(record_text(record), _RECORD)
        self._write(content, name)
        self._write(record_text({**record, name: {hash_of(content)}}), _RECORD)
        return True

    def _write(self, content: bytes, name: str) -> None:
        with translate_write_errors(f"{self.url}/{name}"):
            store, root = open_store(self.url)
            store.pipe_file(f"{root}/{name}", content)

    def _record(self, recording: str) -> tuple[list[str], FileRecord]:
        """The names of all objects in the folder of a recording, and the record of its results.

        Raises:
            RecordingError: They are not results, or cannot be read.
        """
        url = f"{self.url}/{recording}"
        with translate_write_errors(url):
            store, root = open_store(self.url)
            folder = f"{root}/{recording}"
            names = [name.removeprefix(f"{folder}/") for name in store.find(folder)]
            if not names:
                return [], {}
            is_unfinished = _UNFINISHED in names
            record = None
            if is_unfinished or DONE_FILE in names:
                text = store.cat_file(f"{folder}/{_UNFINISHED if is_unfinished else DONE_FILE}")
                record = parse_record(text.decode("utf-8", "replace"), done=not is_unfinished)
        if record is None:
            raise _not_results_error(url)
        return [name for name in names if name != _UNFINISHED], record

    def _objects(self, recording: str) -> tuple[list[str], list[str], FileRecord]:
        """Names of the objects that may be replaced, and of those that stay; the record."""
        names, record = self._record(recording)
        own: list[str] = []
        kept: list[str] = []
        with translate_write_errors(f"{self.url}/{recording}"):
            store, root = open_store(self.url)
            for name in sorted(names):
                hashes = record.get(name, ())
                is_own = name == DONE_FILE
                if not is_own and hashes:
                    with store.open(f"{root}/{recording}/{name}", "rb") as file:
                        is_own = hash_of(file) in hashes
                (own if is_own else kept).append(name)
        return own, kept, record


Results = ResultsFolder | ResultsStore
"""Storage of results. Workers, on other machines too, receive copies."""


def _is_own_text(name: str, found: Mapping[str, str]) -> bool:
    """Whether the lock or the record has a content that `track` writes."""
    text = found.get(name)
    if text is None:
        return False
    if name == LOCK:
        return _OWN_LOCK.fullmatch(text) is not None
    return parse_record(text) is not None


def _not_own_error(path_or_url: str) -> RecordingError:
    return RecordingError(
        f"{path_or_url} is not a file of track, and is not overwritten; move it, or give another "
        "output",
        OUTPUT_EXISTS,
    )


def _changed_error(path_or_url: Path | str) -> RecordingError:
    return RecordingError(
        f"files in {path_or_url} were changed while its recording was tracked, and nothing was "
        "replaced; run the command again",
        FAILED,
    )


def _not_results_error(path_or_url: str) -> RecordingError:
    return RecordingError(
        f"{path_or_url} exists already, holds no results, and is not overwritten; move it, or give "
        "another output",
        OUTPUT_EXISTS,
    )
