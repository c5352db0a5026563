"""The command `track --archive`."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import timedelta
from itertools import islice
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from pf_tracker_ros.evaluation.reports.content import state_columns
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE, fill
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.recordings.archives.executors import Executor, make_executor
from pf_tracker_ros.recordings.archives.memory import required_memory
from pf_tracker_ros.recordings.archives.overlaps import check_no_overlap
from pf_tracker_ros.recordings.archives.recording_filter import any_footage, filter_from_options
from pf_tracker_ros.recordings.archives.results import Results, results_at
from pf_tracker_ros.recordings.archives.sources import (
    PathOrUrl,
    errors_name_source,
    find_recordings,
    local_copy,
)
from pf_tracker_ros.recordings.archives.stores import is_url
from pf_tracker_ros.recordings.archives.tasks import (
    DETECTIONS,
    ArchiveEntry,
    ArchiveTask,
    done_entries,
    make_tasks,
    run_tasks,
    write_manifest,
)
from pf_tracker_ros.recordings.errors import DONE, FAILED, RecordingError
from pf_tracker_ros.recordings.plan import SIDECAR, make_plan, open_from_options
from pf_tracker_ros.recordings.sidecar_files import DETECTIONS_SUFFIX

# What a dry run tracks to tell how long the rest would take.
_SAMPLED_RECORDINGS = 3
_SAMPLED_FRAMES = 60


def run_archive(options: argparse.Namespace) -> int:
    """Track every recording of an archive that is not done, and print a table of all.

    Returns:
        Exit code: 1 if a recording failed.

    Raises:
        RecordingError: The request cannot be carried out.
        FootageError: The archive cannot be read.
    """
    for option, name in (("source", "SOURCE"), ("box", "--box"), ("draw", "--draw")):
        if getattr(options, option) not in (None, False):
            raise RecordingError(f"{name} is for one recording; allowed: without --archive")
    if options.detections is not None and options.detections is not SIDECAR:
        raise RecordingError(
            f"a file of detections is for one recording; allowed here: {DETECTIONS} alone, which "
            f"takes drive{DETECTIONS_SUFFIX} beside drive.mcap"
        )
    if options.report is not None and options.report is not SIDECAR:
        raise RecordingError("--report has no folder here; allowed: beside each boxes.csv")
    results = results_at(options.output)
    recordings = find_recordings(options.archive, filter_from_options(options))
    check_no_overlap(recordings, options.archive, options.output)
    with make_executor(options.ray, options.jobs, required_memory) as executor:
        if options.dry_run:
            _print_plan(make_tasks(recordings, results, _arguments(options)), executor, options)
            _print_left_out(options, recordings)
            return DONE
        with results.locked() as place:
            tasks = make_tasks(recordings, place, _arguments(options))
            exit_code = _run(tasks, place, executor, options)
    _print_left_out(options, recordings)
    return exit_code


def _run(
    tasks: Sequence[ArchiveTask],
    results: Results,
    executor: Executor,
    options: argparse.Namespace,
) -> int:
    found = done_entries(tasks, results)
    waiting = [task for task in tasks if task.name not in found]
    archive = _last(options.archive)
    try:
        with (
            progress_bar(len(waiting), "recordings", archive) as on_progress,
            closing(run_tasks(waiting, executor)) as done,
        ):
            for task, entry in done:
                found[task.name] = entry
                if entry.error:
                    print(f"track: error: {entry.error}", file=sys.stderr)
                for warning in entry.warnings:
                    print(f"track: {entry.name}: {warning}", file=sys.stderr)
                on_progress(archive, 1)
    finally:
        # One may be done of which its worker could not tell any more.
        found = {
            **done_entries([task for task in tasks if task.name not in found], results),
            **found,
        }
        known = [found[task.name] for task in tasks if task.name in found]
        write_manifest(results, known)
    if options.report is not None:
        _write_report(known, options, results)
    _print_table(known, len(waiting), results)
    return FAILED if any(entry.error for entry in known) else DONE


def _last(place: Path | str) -> str:
    """The last part of a path or URL."""
    return PurePosixPath(str(place)).name


def _arguments(options: argparse.Namespace) -> list[str]:
    """The arguments of `track` that are the same for every recording."""
    arguments = [f"--preset={options.preset}", f"--seed={options.seed}"]
    arguments += [f"--parameter={each}" for each in options.parameter]
    arguments += [f"--frame-rate={options.frame_rate or DEFAULT_FRAME_RATE}"]
    if options.bag_topic:
        arguments.append(f"--bag-topic={options.bag_topic}")
    if options.detections:
        arguments.append(DETECTIONS)
    if options.detections_topic:
        arguments.append(f"--detections-topic={options.detections_topic}")
    if options.detector:
        arguments += [
            f"--detector={options.detector}",
            f"--detector-rate={options.detector_rate}",
        ]
    arguments += [f"--{flag}" for flag in ("video", "parquet", "bag") if getattr(options, flag)]
    return arguments + (["--report"] if options.report is not None else [])


def _write_report(
    found: Sequence[ArchiveEntry], options: argparse.Namespace, results: Results
) -> None:
    frames = sum(entry.frames for entry in found)
    failed = sum(bool(entry.error) for entry in found)
    page = fill(
        "archive.html.jinja",
        title=f"{_last(options.archive)}, tracked",
        facts={
            "archive": str(options.archive),
            "preset": options.preset,
            "parameters": ", ".join(options.parameter) or "those of the preset",
            "recordings": f"{len(found)}, of which {failed} failed",
            "frames": str(frames),
        },
        states=_told_states(found),
        # What needs to be looked at comes first.
        rows=[
            {
                "name": entry.name,
                "address": quote(f"{entry.name}/{REPORT_FILE}", errors="surrogateescape"),
                "frames": entry.frames,
                "states": entry.states,
                "error": entry.error,
                "warnings": entry.warnings,
            }
            for entry in sorted(found, key=lambda entry: (not entry.error, not entry.warnings))
        ],
    )
    results.put_text(page, REPORT_FILE)


def _told_states(entries: Sequence[ArchiveEntry]) -> tuple[str, ...]:
    return state_columns({state for entry in entries for state in entry.states})


def _print_table(entries: Sequence[ArchiveEntry], tracked: int, results: Results) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table()
    table.add_column("recording", overflow="fold")
    states = _told_states(entries)
    for heading in ("frames", *states):
        table.add_column(heading, justify="right")
    table.add_column("")
    for entry in entries:
        shares = [
            f"{entry.states.get(state, 0) / entry.frames:.0%}" if entry.frames else ""
            for state in states
        ]
        frames = str(entry.frames) if entry.frames else ""
        # Names go in as Text: square brackets in a plain string are markup to Rich. What is wrong
        # has been told, and would leave the names no room.
        verdict = "failed" if entry.error else "warning" if entry.warnings else ""
        table.add_row(Text(entry.name), frames, *shares, verdict)
    Console().print(table)
    if idle := [entry.name for entry in entries if _is_idle(entry)]:
        print(
            f"track: in {len(idle)} of {counted(len(entries), 'recording')} there was no target in "
            f"any frame, such as in {idle[0]}",
            file=sys.stderr,
        )
    failed = sum(bool(entry.error) for entry in entries)
    print(
        f"{counted(len(entries), 'recording')}: {tracked - failed} tracked, "
        f"{len(entries) - tracked} done before, {failed} failed; results in {results.name}"
    )


def _is_idle(entry: ArchiveEntry) -> bool:
    """Whether a recording was tracked to its end without any target."""
    return not entry.error and entry.states.keys() <= {"idle", "skipped"}


def _print_plan(
    tasks: Sequence[ArchiveTask], executor: Executor, options: argparse.Namespace
) -> None:
    """What would be done, and how long it would take, from a sample."""
    plan = _Plan(options)
    failing = 0
    done = done_entries(tasks, tasks[0].results)
    waiting = [task for task in tasks if task.name not in done]
    for task in waiting:
        try:
            count = plan.look_into(task.source)
        except (FootageError, RecordingError) as error:
            print(f"would fail: {error}")
            failing += 1
        else:
            frames = "an unknown number of frames" if count is None else counted(count, "frame")
            print(f"would track: {task.source} ({frames})")
    text = f"{len(waiting)} of {counted(len(tasks), 'recording')}, "
    text += counted(sum(plan.known), "frame")
    if plan.unknown:
        text += f" and those of {plan.unknown} that do not tell"
    if seconds := plan.seconds_a_frame:
        workers = executor.workers
        left = timedelta(seconds=round(plan.frames * seconds / workers))
        cores = f"{counted(workers, 'core')}, at {1 / seconds:.0f} frames/s"
        text += f"; about {left} on {cores}{' each' if workers > 1 else ''}"
    print(f"{text}; {failing} cannot be tracked" if failing else text)


def _print_left_out(options: argparse.Namespace, recordings: Mapping[str, PathOrUrl]) -> None:
    """Tell of what is left out of a folder: what has no target, or cannot have detections."""
    why, cure = " without a target", "--detections, --detections-topic or --detector finds targets"
    if options.detections_topic:
        why, cure = "", f"{options.detections_topic} is looked for in bags"
    elif filter_from_options(options) is not None:
        return
    if is_url(options.archive):
        return
    # What two rules together would refuse is no reason to fail here.
    with contextlib.suppress(FootageError, RecordingError):
        others = find_recordings(options.archive, any_footage()).keys() - recordings.keys()
        if others:
            verb = "is" if len(others) == 1 else "are"
            print(
                f"{counted(len(others), 'recording')}{why} {verb} left out, such as "
                f"{min(others)}: {cure}"
            )


class _Plan:
    """Looks into recordings, and tracks in the first ones."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self.known: list[int] = []
        self.unknown = 0
        self._sampled, self._tracking = 0, 0.0
        self._copied, self._copying = 0, 0.0

    @property
    def frames(self) -> float:
        """Number of all frames; those that do not tell are taken to be as long as the others."""
        mean = sum(self.known) / len(self.known) if self.known else 0.0
        return sum(self.known) + self.unknown * mean

    @property
    def seconds_a_frame(self) -> float:
        """What a frame takes, its share in the copying of a recording from elsewhere included."""
        copying = self._copying / self._copied if self._copied else 0.0
        return self._tracking / self._sampled + copying if self._sampled else 0.0

    def look_into(self, source: PathOrUrl) -> int | None:
        """The number of frames of a recording, None where it does not tell.

        Raises:
            FootageError: It cannot be read.
            RecordingError: It has no target.
        """
        is_sampled = self._sampled < _SAMPLED_RECORDINGS * _SAMPLED_FRAMES
        if is_url(source) and not is_sampled:
            # To tell it would have to be copied.
            self.unknown += 1
            return None
        began = time.monotonic()
        with local_copy(source) as path, errors_name_source(source, path):
            copying = time.monotonic() - began
            count = self._look_into_copy(path, _SAMPLED_FRAMES if is_sampled else 0)
        if count is None:
            self.unknown += 1
        else:
            self.known.append(count)
            if is_url(source):
                self._copied, self._copying = self._copied + count, self._copying + copying
        return count

    def _look_into_copy(self, path: Path, sample: int) -> int | None:
        options = self._options
        recording = open_from_options(path, options)
        with closing(make_plan(recording, options, is_archived=True)) as plan:
            if sample:
                began = time.monotonic()
                with closing(plan.track()) as tracked:
                    self._sampled += sum(1 for _ in islice(tracked, sample))
                self._tracking += time.monotonic() - began
        return recording.frame_count
