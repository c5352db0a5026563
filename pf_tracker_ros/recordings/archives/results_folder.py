"""Results of an archive in a folder: each recording is written to a hidden folder, then renamed."""

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
    hash_of,
    is_own_file,
    parse_record,
    record_text,
)
from pf_tracker_ros.recordings.archives.own_files import (
    DONE_FILE,
    LOCK,
    RECORD,
    changed_error,
    is_own_text,
    not_own_error,
    not_results_error,
)
from pf_tracker_ros.recordings.errors import FAILED, OUTPUT_EXISTS, RecordingError, unwritable

# Hidden staging folders. A run removes those of a killed run, but not those of `track` on a single
# recording, which have another prefix.
_STAGING_PREFIX = ".archive_"
_STAGING_NAME = re.compile(re.escape(_STAGING_PREFIX) + r"[0-9a-f]{16}_[a-z0-9_]{8}")
# The folder in a staging folder that holds the former results until the new ones are in place.
_BEFORE = "before"
# Bytes of a text that is read back.
_MAX_TEXT = 100 * 10**6


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
                raise changed_error(folder)
            for name in kept:
                _link(folder / name, staged / name)
            if os.path.lexists(folder):
                before.parent.mkdir()
                folder.replace(before)
                if _state(before) != state:
                    raise changed_error(folder)
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
        record = parse_record(self.read([RECORD]).get(RECORD, "")) or {}
        try:
            if os.path.lexists(path) and not is_own_file(path, record):
                return False
            # The hash of the former text stays until the new one is in place.
            record = {**record, name: {*record.get(name, ()), hash_of(content)}}
            self._write(record_text(record), RECORD)
            self._write(content, name)
            self._write(record_text({**record, name: {hash_of(content)}}), RECORD)
        except OSError as error:
            raise unwritable(path, error) from error
        return True

    def _write(self, content: bytes, name: str) -> None:
        with atomic_write(self.path / name, prefix=f"{_STAGING_PREFIX}{self.run}_") as draft:
            draft.write_bytes(content)

    def _check_own_texts(self) -> None:
        """Refuse to write over the lock or record of another program."""
        for name in (LOCK, RECORD):
            if os.path.lexists(self.path / name) and (
                (self.path / name).is_symlink() or not is_own_text(name, self.read([name]))
            ):
                raise not_own_error(str(self.path / name))

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
        raise not_results_error(str(folder))


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
