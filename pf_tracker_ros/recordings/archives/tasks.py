"""Tracks many recordings in parallel, and skips those whose results are up to date.

1. Each task has a key, a hash of the inputs, the version and the arguments.
2. A worker tracks its recording into a staging folder, writes the key to `done.json`, and moves
   the results into place.
3. The next run skips the tasks whose `done.json` has their key.

So a killed worker or driver costs only the recordings in progress.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import platform
from collections import Counter, defaultdict
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from pf_tracker_ros import __version__
from pf_tracker_ros.atomic_files import flush_to_disk
from pf_tracker_ros.evaluation.parallel import WorkerEnded
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.archives.executors import Executor
from pf_tracker_ros.recordings.archives.results import DONE_FILE, Results
from pf_tracker_ros.recordings.archives.sources import PathOrUrl, fingerprint, local_copy
from pf_tracker_ros.recordings.errors import (
    DONE,
    FAILED,
    INTERRUPTED,
    TERMINATED,
    UNREADABLE_SOURCE,
    RecordingError,
    unwritable,
)

_STATES = ("tracking", "occluded", "lost", "idle", "skipped")
MANIFEST = "archive.json"
DETECTIONS = "--detections"
"""Argument that reads the detections beside each recording."""
_ERROR_PREFIX = "track: error: "
# After so many rounds in which every worker ended unexpectedly, the recordings are the cause, such
# as by their memory.
_MAX_FAILED_ROUNDS = 4


@dataclass(frozen=True)
class ArchiveTask:
    """A recording to track.

    Attributes:
        name: Of its folder, relative to the results.
        source: The recording: an absolute path, or a URL.
        results: Storage of its files.
        arguments: Of `track`, without source and output.
        version: Of this package; a worker must have the same.
        key: Hash of the inputs, the version and the arguments.
    """

    name: str
    source: PathOrUrl
    results: Results
    arguments: tuple[str, ...]
    version: str
    key: str


@dataclass(frozen=True)
class ArchiveEntry:
    """The outcome of a task, as in `done.json` and `archive.json`.

    Attributes:
        name: Of its folder.
        source: The recording.
        key: As for `ArchiveTask`.
        exit_code: Of `track`; 0 if the recording was tracked to its end.
        error: Why it was not, or empty. The results of a damaged recording are kept nevertheless.
        frames: Number of frames.
        states: State to number of frames.
        warnings: Of `track`, a sentence each.
    """

    name: str
    source: str
    key: str
    exit_code: int
    error: str
    frames: int
    states: dict[str, int]
    warnings: Sequence[str] = ()


def make_tasks(
    recordings: Mapping[str, PathOrUrl], results: Results, arguments: Sequence[str]
) -> list[ArchiveTask]:
    """Make a task for each recording.

    Args:
        recordings: As `find_recordings` returns them.
        results: Storage of the results.
        arguments: Of `track`, without source and output.
    """
    return [
        ArchiveTask(name, source, results, tuple(arguments), __version__, _key(source, arguments))
        for name, source in recordings.items()
    ]


def done_entries(tasks: Sequence[ArchiveTask], results: Results) -> dict[str, ArchiveEntry]:
    """Name to entry of the tasks whose results are up to date.

    Raises:
        FootageError: The results cannot be read.
    """
    found = {}
    texts = results.read([f"{task.name}/{DONE_FILE}" for task in tasks])
    for task in tasks:
        try:
            entry = ArchiveEntry(**json.loads(texts[f"{task.name}/{DONE_FILE}"]))
        except (KeyError, ValueError, TypeError):
            continue
        # A recording that failed may be readable by now.
        if entry.key == task.key and entry.exit_code == DONE:
            found[task.name] = entry
    return found


def run_tasks(
    tasks: Sequence[ArchiveTask], executor: Executor
) -> Generator[tuple[ArchiveTask, ArchiveEntry], None, None]:
    """Run tasks in rounds; a task whose worker ended unexpectedly is repeated in the next round.

    Tasks that are left fail after several rounds without a completed task.

    Args:
        tasks: To run.
        executor: Runs them.

    Yields:
        A task and its entry, in the order of completion.

    Raises:
        RecordingError: The executor has no workers.
    """
    pending, failed_rounds = list(tasks), 0
    while pending:
        ended: list[tuple[ArchiveTask, WorkerEnded]] = []
        with closing(executor.run(do_task, pending)) as outcomes:
            for number, outcome in outcomes:
                if isinstance(outcome, WorkerEnded):
                    ended.append((pending[number], outcome))
                else:
                    yield pending[number], outcome
        failed_rounds = failed_rounds + 1 if len(ended) == len(pending) else 0
        if failed_rounds == _MAX_FAILED_ROUNDS:
            for task, outcome in ended:
                reason = f"{outcome.reason}, {_MAX_FAILED_ROUNDS} times in a row"
                yield task, _failed(task, FAILED, f"{task.source}: {reason}")
            return
        pending = [task for task, _ in ended]


def do_task(task: ArchiveTask) -> ArchiveEntry | WorkerEnded:
    """Track a recording and put its results into place atomically."""
    if task.version != __version__:
        node = f"{platform.node()} has version {__version__} of this package"
        return _failed(task, FAILED, f"{node}, not {task.version}; install the same everywhere")
    try:
        with local_copy(task.source) as source, task.results.staging_folder(task.name) as staging:
            return _track(task, source, staging / "results")
    except FootageError as error:
        return _failed(task, UNREADABLE_SOURCE, str(error))
    except RecordingError as error:
        return _failed(task, error.exit_code, str(error))


def write_manifest(results: Results, entries: Sequence[ArchiveEntry]) -> None:
    """Write the entries of all recordings to `archive.json` atomically.

    Raises:
        RecordingError: It cannot be written.
    """
    document = [asdict(entry) for entry in entries]
    results.put_text(json.dumps(document, indent=1) + "\n", MANIFEST)


def _track(task: ArchiveTask, source: Path, folder: Path) -> ArchiveEntry | WorkerEnded:
    from pf_tracker_ros.recordings.__main__ import main

    messages = io.StringIO()
    arguments = [str(source), "--output", str(folder), *task.arguments]
    with contextlib.redirect_stderr(messages), contextlib.redirect_stdout(io.StringIO()):
        exit_code = main(arguments, source_name=str(task.source))
    if exit_code in (INTERRUPTED, TERMINATED):
        return WorkerEnded("its worker was stopped")
    is_partial = exit_code == UNREADABLE_SOURCE and (folder / "boxes.csv").exists()
    if exit_code != DONE and not is_partial:
        return _failed(task, exit_code, _error(messages.getvalue()))
    try:
        entry = _entry(task, folder, exit_code, messages.getvalue())
        (folder / DONE_FILE).write_text(json.dumps(asdict(entry), indent=1) + "\n")
        # A folder with an incomplete file could not be replaced.
        flush_to_disk(folder / DONE_FILE)
    except OSError as error:
        raise unwritable(folder, error) from error
    task.results.put(folder, task.name)
    return entry


def _key(source: PathOrUrl, arguments: Sequence[str]) -> str:
    """Hash of the inputs (by the names, sizes and times of the files), version and arguments."""
    inputs = fingerprint(source, with_detections=DETECTIONS in arguments)
    text = json.dumps([__version__, list(arguments), inputs])
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _entry(task: ArchiveTask, folder: Path, exit_code: int, messages: str) -> ArchiveEntry:
    by_frame: dict[str, set[str]] = defaultdict(set)
    with (folder / "boxes.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            by_frame[row["frame"]].add(row["state"])
    # The state of a frame is that of its best target.
    states = Counter(min(found, key=_STATES.index) for found in by_frame.values())
    error = "" if exit_code == DONE else _error(messages)
    counts = (states.total(), dict(states))
    source = str(task.source)
    return ArchiveEntry(task.name, source, task.key, exit_code, error, *counts, _warnings(messages))


def _failed(task: ArchiveTask, exit_code: int, error: str) -> ArchiveEntry:
    return ArchiveEntry(task.name, str(task.source), task.key, exit_code, error, 0, {})


def _warnings(messages: str) -> list[str]:
    prefix = "track: "
    lines = [line for line in messages.splitlines() if line.startswith(prefix)]
    return [line.removeprefix(prefix) for line in lines if not line.startswith(_ERROR_PREFIX)]


def _error(messages: str) -> str:
    lines = messages.strip().splitlines()
    return lines[-1].removeprefix(_ERROR_PREFIX) if lines else "it failed without a message"
