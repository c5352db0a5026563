"""Many recordings, in parallel over processes, such that what is done is not done again.

Each recording gets a folder of its own below the output folder, which comes there whole, by a
renaming, with a `done.json` that says of which inputs, version and parameters it is. So an end at
any time, of a worker or of all of them, costs only what was under way.
"""

from __future__ import annotations

import contextlib
import csv
import fcntl
import hashlib
import io
import json
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from pf_tracker_ros import __version__
from pf_tracker_ros.evaluation.processes import ProcessEnded, spread
from pf_tracker_ros.footage import FootageError, is_bag
from pf_tracker_ros.footage.access import entries, exists
from pf_tracker_ros.footage.ground_truth import ground_truth_file
from pf_tracker_ros.recordings.errors import (
    DONE,
    FAILED,
    OUTPUT_EXISTS,
    RecordingError,
    unwritable,
)
from pf_tracker_ros.recordings.target import TARGET_ENDING, target_file

DONE_FILE = "done.json"
MANIFEST = "archive.json"
LOCK = ".lock"
_WORKPLACE = ".track_"
# A process that ends again and again does so for the recording's sake, such as for its memory.
_MOST_ATTEMPTS = 4


@dataclass(frozen=True)
class ArchiveTask:
    """A recording to track.

    Attributes:
        name: Of its folder, relative to the output folder.
        source: The recording, absolute.
        folder: Where its files go.
        arguments: Of `track`, but for source and output.
        key: Stands for the inputs, the version and the parameters.
    """

    name: str
    source: Path
    folder: Path
    arguments: tuple[str, ...]
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
    """

    name: str
    source: str
    key: str
    exit_code: int
    error: str
    frames: int
    states: dict[str, int]


def find_recordings(archive: Path) -> dict[str, Path]:
    """The recordings of an archive: those with a target file, and sequence folders.

    Args:
        archive: A folder that is searched with all below it; or a text file that lists one
            recording a line, relative to the file, empty lines and those after `#` left out.

    Returns:
        Name, unique among them, to path; sorted by name for a folder, else as listed.

    Raises:
        RecordingError: Two recordings share a name, or there is none.
        FootageError: There is no such archive, or it cannot be read.
    """
    if not exists(archive):
        raise FootageError(f"there is no archive {archive}; give a folder, or a file with a list")
    if archive.is_dir():
        base, paths = archive, sorted(set(_below(archive)))
    else:
        base, paths = archive.parent, list(_listed(archive))
    found: dict[str, Path] = {}
    for path in paths:
        name = _name(path, base)
        if name in found:
            raise RecordingError(
                f"{found[name]} and {path} would both be written as {name}; name one otherwise"
            )
        found[name] = path
    _check_names(found)
    if not found:
        raise RecordingError(
            f"no recording in {archive}; each needs its target beside it, such as drive"
            f"{TARGET_ENDING} for drive.mcap, or a ground truth in its folder"
        )
    return found


def make_tasks(
    recordings: dict[str, Path], output: Path, arguments: Sequence[str]
) -> list[ArchiveTask]:
    """What there is to do for recordings, done or not.

    Args:
        recordings: As `find_recordings` returns them.
        output: Where the results go.
        arguments: Of `track`, but for source and output.
    """
    return [
        ArchiveTask(name, path, output / name, tuple(arguments), _key(path, arguments))
        for name, path in recordings.items()
    ]


def done_entry(task: ArchiveTask) -> ArchiveEntry | None:
    """What is there of a task, if that is of the same inputs, version and parameters."""
    try:
        document = json.loads((task.folder / DONE_FILE).read_text(encoding="utf-8"))
        entry = ArchiveEntry(**document)
    except (OSError, ValueError, TypeError):
        return None
    return entry if entry.key == task.key else None


def run_tasks(
    tasks: Sequence[ArchiveTask], jobs: int
) -> Generator[tuple[ArchiveTask, ArchiveEntry], None, None]:
    """Do tasks in several processes; one whose process ends unexpectedly is done again.

    Yields:
        A task and what came of it, in the order in which they are done.
    """
    waiting = list(tasks)
    for attempt in range(_MOST_ATTEMPTS):
        again = []
        with closing(spread(do_task, waiting, jobs)) as answers:
            for number, answer in answers:
                task = waiting[number]
                if not isinstance(answer, ProcessEnded):
                    yield task, answer
                elif attempt + 1 < _MOST_ATTEMPTS:
                    again.append(task)
                else:
                    how = f"its process ended with code {answer.exit_code}, {attempt + 1} times"
                    yield task, _failed(task, FAILED, f"{task.source}: {how}")
        waiting = again
        if not waiting:
            return


def do_task(task: ArchiveTask) -> ArchiveEntry:
    """Track a recording into its folder, whole or not at all."""
    from pf_tracker_ros.recordings.__main__ import main

    said = io.StringIO()
    try:
        task.folder.parent.mkdir(parents=True, exist_ok=True)
        workplace = Path(tempfile.mkdtemp(prefix=_WORKPLACE, dir=task.folder.parent))
    except OSError as error:
        failure = unwritable(task.folder, error)
        return _failed(task, failure.exit_code, str(failure))
    try:
        results = workplace / "results"
        arguments = [str(task.source), "--output", str(results), *task.arguments]
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = main(arguments)
        if code != DONE:
            return _failed(task, code, _sentence(said.getvalue()))
        entry = _entry(task, results)
        (results / DONE_FILE).write_text(json.dumps(asdict(entry), indent=1) + "\n")
        _replace(results, task.folder, workplace)
        return entry
    except OSError as error:
        failure = unwritable(task.folder, error)
        return _failed(task, failure.exit_code, str(failure))
    finally:
        shutil.rmtree(workplace, ignore_errors=True)


@contextlib.contextmanager
def alone_in(output: Path) -> Iterator[None]:
    """Keep every other run out of an output folder, and leave nothing there that is under way.

    Raises:
        RecordingError: Another run is at work there, or nothing can be written there.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        lock = (output / LOCK).open("w")
    except OSError as error:
        raise unwritable(output, error) from error
    with lock:
        try:
            # The system gives it up with the process, however that ends.
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RecordingError(
                f"another run is writing into {output}; wait for it, or give another folder",
                OUTPUT_EXISTS,
            ) from error
        _clean_up(output)
        try:
            yield
        finally:
            _clean_up(output)


def _clean_up(output: Path) -> None:
    for path in output.rglob(f"{_WORKPLACE}*"):
        shutil.rmtree(path, ignore_errors=True)


def write_manifest(output: Path, entries_by_name: dict[str, ArchiveEntry]) -> None:
    """Write what is known of all recordings, whole or not at all.

    Raises:
        RecordingError: It cannot be written.
    """
    document = [asdict(entry) for entry in entries_by_name.values()]
    write_whole(output / MANIFEST, json.dumps(document, indent=1) + "\n")


def write_whole(path: Path, text: str) -> None:
    """Write a file anew, whole or not at all.

    Raises:
        RecordingError: It cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=_WORKPLACE, dir=path.parent) as folder:
            draft = Path(folder) / path.name
            draft.write_text(text, encoding="utf-8", errors="replace")
            draft.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error


def _below(folder: Path) -> Iterator[Path]:
    if ground_truth_file(folder) is not None:
        yield folder.resolve()
        return
    for path in entries(folder):
        if path.name.startswith("."):
            continue
        has_target = not path.name.endswith(TARGET_ENDING) and exists(target_file(path))
        if has_target and _is_recording(path):
            yield path.resolve()
        elif path.is_dir() and not path.is_symlink():
            yield from _below(path)


def _is_recording(path: Path) -> bool:
    """Whether this is what the target file beside it is for, and not another file of that name."""
    named = _named_in(target_file(path))
    return (
        path.resolve().name == named if named else path.is_dir() or is_bag(path) or _is_only(path)
    )


def _named_in(path: Path) -> str | None:
    import yaml

    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return None
    named = document.get("recording") if isinstance(document, dict) else None
    return named if isinstance(named, str) else None


def _is_only(path: Path) -> bool:
    beside = [each for each in entries(path.parent) if target_file(each) == target_file(path)]
    return [each for each in beside if not each.name.endswith(TARGET_ENDING)] == [path]


def _listed(path: Path) -> Iterator[Path]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise FootageError(f"the list {path} cannot be read ({error})") from error
    for line in lines:
        text = line.partition("#")[0].strip()
        if text:
            # One that is not there is told of with the others that fail.
            yield (path.parent / Path(text).expanduser()).absolute()


def _name(path: Path, base: Path) -> str:
    """The folder of a recording's results: its path below the archive."""
    inside = base.resolve()
    relative = path.relative_to(inside) if path.is_relative_to(inside) else Path(path.name)
    return str(relative) if relative.parts else path.name


def _check_names(found: dict[str, Path]) -> None:
    """Refuse a recording whose results would lie among those of another one."""
    for name, path in found.items():
        for parent in Path(name).parents:
            if str(parent) in found:
                raise RecordingError(
                    f"{path} is inside of {found[str(parent)]}, which is a recording itself; list "
                    "one of them"
                )


def _key(source: Path, arguments: Iterable[str]) -> str:
    """Stands for the inputs, as their names, sizes and times tell them, version and parameters."""
    inputs = []
    files = [source, target_file(source)]
    if source.is_dir():
        files += sorted(path for path in source.rglob("*") if path.is_file())
    for path in files:
        with contextlib.suppress(OSError):
            status = path.stat()
            is_file = path.is_file()
            inputs.append([str(path), status.st_size if is_file else 0, status.st_mtime_ns])
    text = json.dumps([__version__, list(arguments), inputs])
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _entry(task: ArchiveTask, results: Path) -> ArchiveEntry:
    with (results / "boxes.csv").open(newline="", encoding="utf-8") as file:
        states = Counter(row["state"] for row in csv.DictReader(file))
    return ArchiveEntry(
        task.name, str(task.source), task.key, DONE, "", states.total(), dict(states)
    )


def _failed(task: ArchiveTask, exit_code: int, error: str) -> ArchiveEntry:
    return ArchiveEntry(task.name, str(task.source), task.key, exit_code, error, 0, {})


def _sentence(said: str) -> str:
    lines = said.strip().splitlines()
    return lines[-1].removeprefix("track: error: ") if lines else "it failed without a word"


def _replace(results: Path, folder: Path, workplace: Path) -> None:
    """Put a folder in the place of another one, of which nothing is left."""
    if os.path.lexists(folder):
        folder.replace(workplace / "before")
    results.replace(folder)
