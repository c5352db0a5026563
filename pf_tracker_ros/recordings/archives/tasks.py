"""Many recordings, in parallel, such that what is done is not done again.

What there is of each recording comes into place whole, with a `done.json` that says of which
inputs, version and parameters it is. So an end at any time, of a worker or of all of them, costs
only what was under way.
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
"""Argument for the detections beside each recording."""
# If all workers end and nothing gets done, it is for their recordings' sake, such as for memory.
_FRUITLESS_ROUNDS = 4


@dataclass(frozen=True)
class ArchiveTask:
    """A recording to track.

    Attributes:
        name: Of its folder, relative to the results.
        source: The recording: an absolute path, or a URL.
        results: Where its files go.
        arguments: Of `track`, but for source and output.
        version: Of this package, the same for who does it.
        key: Stands for the inputs, the version and the parameters.
    """

    name: str
    source: PathOrUrl
    results: Results
    arguments: tuple[str, ...]
    version: str
    key: str


@dataclass(frozen=True)
class ArchiveEntry:
    """What came of a recording.

    Attributes:
        name: Of its folder.
        source: The recording.
        key: As for `ArchiveTask`.
        exit_code: Of `track`; 0 if it was tracked to its end.
        error: Why it was not, or empty.
        frames: Number of frames.
        states: State to number of frames.
        warnings: What there is to say of it beside that, a sentence each.
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
    """What there is to do for recordings, done or not.

    Args:
        recordings: As `find_recordings` returns them.
        results: Where the results go.
        arguments: Of `track`, but for source and output.
    """
    return [
        ArchiveTask(name, source, results, tuple(arguments), __version__, _key(source, arguments))
        for name, source in recordings.items()
    ]


def done_entries(tasks: Sequence[ArchiveTask], results: Results) -> dict[str, ArchiveEntry]:
    """Name to what is there of those tasks that are done, of the same inputs and so on.

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
        if entry.key == task.key:
            found[task.name] = entry
    return found


def run_tasks(
    tasks: Sequence[ArchiveTask], executor: Executor
) -> Generator[tuple[ArchiveTask, ArchiveEntry], None, None]:
    """Do tasks; those whose workers end unexpectedly are done again, as long as anything gets done.

    Args:
        tasks: What is to be done.
        executor: Who does it.

    Yields:
        A task and what came of it, in the order in which they are done.

    Raises:
        RecordingError: There is nobody to do it.
    """
    waiting, fruitless = list(tasks), 0
    while waiting:
        ended: list[tuple[ArchiveTask, WorkerEnded]] = []
        with closing(executor.run(do_task, waiting)) as answers:
            for number, answer in answers:
                if isinstance(answer, WorkerEnded):
                    ended.append((waiting[number], answer))
                else:
                    yield waiting[number], answer
        fruitless = fruitless + 1 if len(ended) == len(waiting) else 0
        if fruitless == _FRUITLESS_ROUNDS:
            for task, answer in ended:
                how = f"{answer.reason}, again and again"
                yield task, _failed(task, FAILED, f"{task.source}: {how}")
            return
        waiting = [task for task, _ in ended]


def do_task(task: ArchiveTask) -> ArchiveEntry | WorkerEnded:
    """Track a recording into its place among the results, whole or not at all."""
    if task.version != __version__:
        what = f"{platform.node()} has version {__version__} of this package"
        return _failed(task, FAILED, f"{what}, and not {task.version}; install the same everywhere")
    try:
        with local_copy(task.source) as source, task.results.staging_folder(task.name) as workplace:
            return _tracked(task, source, workplace / "results")
    except FootageError as error:
        return _failed(task, UNREADABLE_SOURCE, str(error))
    except RecordingError as error:
        return _failed(task, error.exit_code, str(error))


def write_manifest(results: Results, entries: Sequence[ArchiveEntry]) -> None:
    """Write what is known of all recordings, whole or not at all.

    Raises:
        RecordingError: It cannot be written.
    """
    document = [asdict(entry) for entry in entries]
    results.put_text(json.dumps(document, indent=1) + "\n", MANIFEST)


def _tracked(task: ArchiveTask, source: Path, made: Path) -> ArchiveEntry | WorkerEnded:
    from pf_tracker_ros.recordings.__main__ import main

    said = io.StringIO()
    arguments = [str(source), "--output", str(made), *task.arguments]
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = main(arguments, source_name=str(task.source))
    if code in (INTERRUPTED, TERMINATED):
        return WorkerEnded("its worker was asked to end")
    if code != DONE:
        return _failed(task, code, _sentence(said.getvalue()))
    try:
        entry = _entry(task, made, _warnings(said.getvalue()))
        (made / DONE_FILE).write_text(json.dumps(asdict(entry), indent=1) + "\n")
        # Only whole ones let their folder be replaced.
        flush_to_disk(made / DONE_FILE)
    except OSError as error:
        raise unwritable(made, error) from error
    task.results.put(made, task.name)
    return entry


def _key(source: PathOrUrl, arguments: Sequence[str]) -> str:
    """Stands for the inputs, as their names, sizes and times tell them, version and parameters."""
    state = fingerprint(source, with_detections=DETECTIONS in arguments)
    text = json.dumps([__version__, list(arguments), state])
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _entry(task: ArchiveTask, made: Path, warnings: Sequence[str]) -> ArchiveEntry:
    by_frame: dict[str, set[str]] = defaultdict(set)
    with (made / "boxes.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            by_frame[row["frame"]].add(row["state"])
    # A frame is as the target in it that is seen best.
    states = Counter(min(found, key=_STATES.index) for found in by_frame.values())
    return ArchiveEntry(
        task.name, str(task.source), task.key, DONE, "", states.total(), dict(states), warnings
    )


def _failed(task: ArchiveTask, exit_code: int, error: str) -> ArchiveEntry:
    return ArchiveEntry(task.name, str(task.source), task.key, exit_code, error, 0, {})


def _warnings(said: str) -> list[str]:
    """What `track` had to say of a recording that it has tracked."""
    prefix = "track: "
    return [line.removeprefix(prefix) for line in said.splitlines() if line.startswith(prefix)]


def _sentence(said: str) -> str:
    lines = said.strip().splitlines()
    return lines[-1].removeprefix("track: error: ") if lines else "it failed without a word"
