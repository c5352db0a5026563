"""Results of an archive in an object store: atomic objects, and the `done.json` of each last."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pf_tracker_ros.recordings.archives.file_records import (
    FileRecord,
    file_hashes,
    hash_of,
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
from pf_tracker_ros.recordings.archives.scratch import scratch_folder
from pf_tracker_ros.recordings.archives.stores import (
    open_store,
    translate_read_errors,
    translate_write_errors,
)

# The record of the objects in a store that may be replaced although `done.json` is missing.
_UNFINISHED = ".track_unfinished"


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
        found = self.read([LOCK, RECORD])
        for name in found:
            if not is_own_text(name, found):
                raise not_own_error(f"{self.url}/{name}")
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
            raise changed_error(f"{self.url}/{recording}")
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
        found, content = self.read([name, RECORD]), text.encode("utf-8", "replace")
        record = parse_record(found.get(RECORD, "")) or {}
        if name in found and hash_of(found[name].encode()) not in record.get(name, ()):
            return False
        record = {**record, name: {*record.get(name, ()), hash_of(content)}}
        self._write(record_text(record), RECORD)
        self._write(content, name)
        self._write(record_text({**record, name: {hash_of(content)}}), RECORD)
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
            raise not_results_error(url)
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
