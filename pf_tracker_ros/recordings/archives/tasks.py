"""Tracks many recordings in parallel, and skips those whose results are up to date.

1. Each task has a key, a hash of the inputs, the version and the options.
2. A worker tracks its recording into a staging folder, writes the key to `done.json`, and moves
   the results into place.
3. The next run skips the tasks whose `done.json` has their key.

So a killed worker or driver costs only the recordings in progress.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from copy import copy
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pf_tracker_ros import __version__
from pf_tracker_ros.atomic_files import flush_to_disk
from pf_tracker_ros.evaluation.parallel import WorkerEnded
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.stamp_order import WINDOW
from pf_tracker_ros.opencv import quiet_opencv
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.recordings.archives.executors import Executor
from pf_tracker_ros.recordings.archives.file_records import file_hashes, parse_json
from pf_tracker_ros.recordings.archives.own_files import DONE_FILE
from pf_tracker_ros.recordings.archives.results import Results
from pf_tracker_ros.recordings.archives.sources import (
    PathOrUrl,
    errors_name_source,
    fingerprint,
    local_copy,
)
from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.errors import (
    DONE,
    FAILED,
    REFUSED,
    UNREADABLE_SOURCE,
    RecordingError,
    unwritable,
)
from pf_tracker_ros.recordings.output_files import BOXES
from pf_tracker_ros.recordings.plan import SIDECAR, uses_detector
from pf_tracker_ros.recordings.run import Stop, check_packages, run_recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, read_targets

MANIFEST = "archive.json"
# Options without an effect on the results of a recording. The parameters of a file are merged into
# the others.
_WITHOUT_EFFECT = {
    *("source", "output", "archive", "jobs", "ray", "dry_run", "params_file", "from_file")
}
# After so many rounds in which every worker ended unexpectedly, the recordings are the cause, such
# as by their memory.
_MAX_FAILED_ROUNDS = 4
# Bytes of a worker and of a pixel of its images, measured with images of 0.3 to 8 megapixels, and
# of the images of a bag that wait to be sorted.
_WORKER, _PIXEL = 250 * 10**6, 30 + 3 * WINDOW
# Further outputs: their libraries, queued images and frame summaries.
_OUTPUTS, _OUTPUT_PIXEL = 70 * 10**6, 50
_REPORT = 250 * 10**6
# Detections: the frame buffer for late ones, and SciPy.
_DETECTIONS = 120 * 10**6
# Assumed if unknown; rather too large, because a task fails with too little memory.
_DEFAULT_IMAGE_SIZE = (3840, 2160)


@dataclass(frozen=True)
class ArchiveTask:
    """A recording to track.

    Attributes:
        name: Of its folder, relative to the results.
        source: The recording: an absolute path, or a URL.
        results: Storage of its files.
        options: Of the command line of the archive.
        version: Of this package; a worker must have the same.
        key: Hash of the inputs, the version and the options.
    """

    name: str
    source: PathOrUrl
    results: Results
    options: argparse.Namespace = field(compare=False)
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
        files: Name to SHA-256 of each file of the results.
        kept: Names in the folder that were added or changed since an earlier run wrote it, and so
            were not replaced.
    """

    name: str
    source: str
    key: str
    exit_code: int
    error: str
    frames: int
    states: dict[str, int]
    warnings: Sequence[str] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    kept: Sequence[str] = ()

    @property
    def unwritten(self) -> list[str]:
        """Names of files of this run that were not written, because others are kept."""
        return [name for name in self.kept if name in self.files]

    @property
    def kept_sentence(self) -> str:
        """What was kept, and what to do; empty if nothing was."""
        others = [name for name in self.kept if name not in self.files]
        parts = []
        if self.unwritten:
            parts.append(
                f"{', '.join(self.unwritten)} (added or changed since) in place of the new "
                "version; move it, and run the command again"
            )
        if others:
            parts.append(f"{', '.join(others)} (added or changed since)")
        return f"kept {'; kept '.join(parts)}" if parts else ""


def make_tasks(
    recordings: Mapping[str, PathOrUrl], results: Results, options: argparse.Namespace
) -> list[ArchiveTask]:
    """Make a task for each recording."""
    return [
        ArchiveTask(name, source, results, options, __version__, _key(source, options))
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
        entry = _parse_entry(texts.get(f"{task.name}/{DONE_FILE}", ""))
        # A recording that failed may be readable by now.
        if entry is not None and entry.key == task.key and entry.exit_code == DONE:
            found[task.name] = replace(entry, name=task.name)
    complete = results.complete({name: entry.files for name, entry in found.items()})
    return {name: entry for name, entry in found.items() if name in complete}


def _parse_entry(text: str) -> ArchiveEntry | None:
    """The entry in the text of a `done.json`, of any origin; None if it is none."""
    try:
        values = parse_json(text)
    except ValueError:
        return None
    if not isinstance(values, dict) or values.keys() != _ENTRY_TYPES.keys():
        return None
    if any(not _ENTRY_TYPES[name](value) for name, value in values.items()):
        return None
    return ArchiveEntry(**values)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 53


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


def _are_counts(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_count, value.values()))


def _are_named_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value.values()))


# Attribute of an entry to the check of its value.
_ENTRY_TYPES: Mapping[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("name", "source", "key", "error"), _is_text),
    **dict.fromkeys(("exit_code", "frames"), _is_count),
    **dict.fromkeys(("warnings", "kept"), _are_texts),
    "states": _are_counts,
    "files": _are_named_texts,
}


def run_tasks(
    tasks: Sequence[ArchiveTask], executor: Executor
) -> Generator[tuple[ArchiveTask, ArchiveEntry], None, None]:
    """Run tasks in rounds; a task whose worker ended unexpectedly is repeated in the next round.

    Tasks that are left fail after several rounds without a completed task.

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
    except (EvaluationError, ParameterError) as error:
        return _failed(task, REFUSED, str(error))


def write_manifest(results: Results, entries: Sequence[ArchiveEntry]) -> bool:
    """Write the entries of all recordings to `archive.json` atomically.

    Returns:
        Whether it was written; False if another file of this name stays in its place.

    Raises:
        RecordingError: It cannot be written.
    """
    document = [asdict(entry) for entry in entries]
    return results.put_text(json.dumps(document, indent=1) + "\n", MANIFEST)


def _track(task: ArchiveTask, source: Path, folder: Path) -> ArchiveEntry | WorkerEnded:
    options, name, stop = copy(task.options), str(task.source), Stop()
    options.output = folder
    if options.report is not None:
        options.report = folder
    if options.detections is not None:
        # A copy in another process is not the same object.
        options.detections = SIDECAR
    check_packages(options)
    try:
        with stop.handled(), quiet_opencv(), errors_name_source(name, source):
            summary = run_recording(options, source, name, stop)
    except KeyboardInterrupt:
        return WorkerEnded("its worker was stopped")
    if stop.exit_code:
        return WorkerEnded("its worker was stopped")
    exit_code, error = summary.exit_code, _in_one_line("; ".join(summary.errors))
    is_partial = exit_code == UNREADABLE_SOURCE and (folder / BOXES).exists()
    if exit_code != DONE and not is_partial:
        return _failed(task, exit_code, error)
    try:
        kept = task.results.kept_files(task.name)
        entry = ArchiveEntry(
            task.name,
            name,
            task.key,
            exit_code,
            error,
            summary.frames,
            dict(summary.states),
            [_in_one_line(each) for each in summary.warnings],
            file_hashes(folder),
            kept,
        )
        (folder / DONE_FILE).write_text(json.dumps(asdict(entry), indent=1) + "\n")
        # A folder with an incomplete file could not be replaced.
        flush_to_disk(folder / DONE_FILE)
    except OSError as failure:
        raise unwritable(folder, failure) from failure
    task.results.put(folder, task.name, kept)
    return entry


def _key(source: PathOrUrl, options: argparse.Namespace) -> str:
    """Hash of the inputs (by the names, sizes and times of the files), version and options."""
    inputs = fingerprint(source, with_detections=options.detections is not None)
    given = {name: one for name, one in vars(options).items() if name not in _WITHOUT_EFFECT}
    text = json.dumps([__version__, given, inputs], default=str)
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _failed(task: ArchiveTask, exit_code: int, error: str) -> ArchiveEntry:
    text = _in_one_line(error)
    return ArchiveEntry(task.name, str(task.source), task.key, exit_code, text, 0, {})


def _in_one_line(text: str) -> str:
    return " ".join(text.split())


def required_memory(task: ArchiveTask) -> int:
    """Bytes that a worker needs for a task, from the image size in its target file.

    The recording itself is not opened, so a broken one fails in its worker.
    """
    targets = _targets(task)
    width, height = (targets[0].image_size if targets else None) or _DEFAULT_IMAGE_SIZE
    needed = _WORKER + _PIXEL * width * height
    has_report = task.options.report is not None
    if uses_detector(task.options):
        needed += _DETECTIONS
    if task.options.video or task.options.bag or has_report:
        needed += _OUTPUTS + _OUTPUT_PIXEL * width * height
    return needed + (_REPORT if has_report else 0)


def _targets(task: ArchiveTask) -> tuple[Target, ...]:
    """The targets in a task's target file; empty if it cannot be read."""
    if is_url(task.source):
        return ()
    source = Path(task.source)
    try:
        return read_targets(target_file(source), source)
    except (RecordingError, OSError):
        return ()
