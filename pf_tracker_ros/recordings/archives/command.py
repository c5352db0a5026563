"""The command `track --archive`.

1. Find the recordings, and check that the results do not overlap them.
2. Skip the recordings whose results are up to date.
3. Track the others in parallel; each writes its results atomically.
4. Write the manifest `archive.json`, the report if requested, and print a table.

A dry run estimates the time from the first frames of the first recordings.
"""

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
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.recordings.archives.executors import Executor, make_executor
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
    MANIFEST,
    ArchiveEntry,
    ArchiveTask,
    done_entries,
    make_tasks,
    required_memory,
    run_tasks,
    write_manifest,
)
from pf_tracker_ros.recordings.errors import DONE, FAILED, FILES_KEPT, RecordingError
from pf_tracker_ros.recordings.plan import SIDECAR, make_plan, open_from_options
from pf_tracker_ros.recordings.sidecar_files import DETECTIONS_SUFFIX

# A dry run tracks about this many recordings, and this many frames of each.
_SAMPLED_RECORDINGS = 3
_SAMPLED_FRAMES = 60


def run_archive(options: argparse.Namespace) -> int:
    """Track every recording of an archive without up-to-date results, and print a table of all.

    Returns:
        Exit code: 1 if a recording failed, 9 if files were kept that track has not written.

    Raises:
        RecordingError: The request is invalid.
        FootageError: The archive cannot be read.
    """
    for option, name in (
        ("source", "SOURCE"),
        ("box", "--box"),
        ("draw", "--draw"),
        ("keyframes", "--keyframes"),
    ):
        if getattr(options, option) not in (None, False):
            raise RecordingError(f"{name} applies to a single recording; leave it out")
    if options.detections is not None and options.detections is not SIDECAR:
        raise RecordingError(
            "--detections FILE applies to a single recording; allowed with --archive: --detections "
            f"alone, which reads drive{DETECTIONS_SUFFIX} beside drive.mcap"
        )
    if options.report is not None and options.report is not SIDECAR:
        raise RecordingError(
            "--report DIR applies to a single recording; allowed with --archive: --report alone, "
            "which writes beside each boxes.csv"
        )
    results = results_at(options.output)
    recordings = find_recordings(options.archive, filter_from_options(options))
    check_no_overlap(recordings, options.archive, options.output)
    with make_executor(options.ray, options.jobs, required_memory) as executor:
        if options.dry_run:
            _print_plan(make_tasks(recordings, results, options), executor, options)
            _print_excluded(options, recordings)
            return DONE
        with results.locked() as locked:
            tasks = make_tasks(recordings, locked, options)
            exit_code = _run(tasks, locked, executor, options)
    _print_excluded(options, recordings)
    return exit_code


def _run(
    tasks: Sequence[ArchiveTask],
    results: Results,
    executor: Executor,
    options: argparse.Namespace,
) -> int:
    entries = done_entries(tasks, results)
    pending = [task for task in tasks if task.name not in entries]
    archive = _base_name(options.archive)
    # Files that are not of this run stay. Those that have no new file in their place are reported
    # only by the run that meets them.
    kept = [
        f"{results.name}/{entry.name}: {entry.kept_sentence}"
        for entry in entries.values()
        if entry.unwritten
    ]
    try:
        with (
            progress_bar(len(pending), "recordings", archive) as on_progress,
            closing(run_tasks(pending, executor)) as finished,
        ):
            for task, entry in finished:
                entries[task.name] = entry
                if entry.error:
                    print(f"track: error: {entry.error}", file=sys.stderr)
                for warning in entry.warnings:
                    print(f"track: {entry.name}: {warning}", file=sys.stderr)
                if entry.kept:
                    kept.append(f"{results.name}/{entry.name}: {entry.kept_sentence}")
                on_progress(archive, 1)
    finally:
        # A worker may have ended after its results were in place, but before it returned.
        missing = [task for task in tasks if task.name not in entries]
        entries = {**done_entries(missing, results), **entries}
        known = [entries[task.name] for task in tasks if task.name in entries]
        if not write_manifest(results, known):
            kept.append(_kept_text(results, MANIFEST))
    if options.report is not None and not _write_report(known, options, results):
        kept.append(_kept_text(results, REPORT_FILE))
    _print_table(known, len(pending), results)
    for sentence in kept:
        print(f"track: {sentence}", file=sys.stderr)
    if any(entry.error for entry in known):
        return FAILED
    return FILES_KEPT if kept else DONE


def _kept_text(results: Results, name: str) -> str:
    return (
        f"{results.name}: kept {name} (added or changed since) in place of the new version; move "
        "it, and run the command again"
    )


def _base_name(path_or_url: PathOrUrl) -> str:
    """The last part of a path or URL."""
    return PurePosixPath(str(path_or_url)).name


def _write_report(
    entries: Sequence[ArchiveEntry], options: argparse.Namespace, results: Results
) -> bool:
    """Write the report of the archive; see `Results.put_text`."""
    frames = sum(entry.frames for entry in entries)
    failed = sum(bool(entry.error) for entry in entries)
    page = fill(
        "archive.html.jinja",
        title=f"{_base_name(options.archive)}, tracked",
        facts={
            "archive": str(options.archive),
            "preset": options.preset,
            "parameters": ", ".join(options.parameter) or "those of the preset",
            "recordings": f"{len(entries)}, of which {failed} failed",
            "frames": str(frames),
        },
        states=_state_columns(entries),
        # Errors first, then warnings.
        rows=[
            {
                "name": entry.name,
                "address": quote(f"{entry.name}/{REPORT_FILE}", errors="surrogateescape"),
                "frames": entry.frames,
                "states": entry.states,
                "error": entry.error,
                "warnings": entry.warnings,
            }
            for entry in sorted(entries, key=lambda entry: (not entry.error, not entry.warnings))
        ],
    )
    return results.put_text(page, REPORT_FILE)


def _state_columns(entries: Sequence[ArchiveEntry]) -> tuple[str, ...]:
    return state_columns({state for entry in entries for state in entry.states})


def _print_table(entries: Sequence[ArchiveEntry], pending_count: int, results: Results) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table()
    table.add_column("recording", overflow="fold")
    states = _state_columns(entries)
    for heading in ("frames", *states):
        table.add_column(heading, justify="right")
    table.add_column("")
    for entry in entries:
        shares = [
            f"{entry.states.get(state, 0) / entry.frames:.0%}" if entry.frames else ""
            for state in states
        ]
        frames = str(entry.frames) if entry.frames else ""
        # Text, because Rich reads square brackets in a plain string as markup. Messages were
        # printed before and would take the space of the names.
        outcome = "failed" if entry.error else "warning" if entry.warnings else ""
        table.add_row(Text(entry.name), frames, *shares, outcome)
    Console().print(table)
    if idle := [entry.name for entry in entries if _is_idle(entry)]:
        print(
            f"track: {len(idle)} of {counted(len(entries), 'recording')} had no target in any "
            f"frame, such as {idle[0]}",
            file=sys.stderr,
        )
    failed = sum(bool(entry.error) for entry in entries)
    print(
        f"{counted(len(entries), 'recording')}: {pending_count - failed} tracked, "
        f"{len(entries) - pending_count} up to date, {failed} failed; results in {results.name}"
    )


def _is_idle(entry: ArchiveEntry) -> bool:
    """Whether a recording was tracked to its end without a target."""
    return not entry.error and entry.states.keys() <= {"idle", "skipped"}


def _print_plan(
    tasks: Sequence[ArchiveTask], executor: Executor, options: argparse.Namespace
) -> None:
    """Print what would be tracked, and an estimate of the time from a sample."""
    estimate = _TimeEstimate(options)
    failing = 0
    done = done_entries(tasks, tasks[0].results)
    pending = [task for task in tasks if task.name not in done]
    for task in pending:
        try:
            count = estimate.add(task.source)
        except (FootageError, RecordingError) as error:
            print(f"would fail: {error}")
            failing += 1
        else:
            frames = "an unknown number of frames" if count is None else counted(count, "frame")
            print(f"would track: {task.source} ({frames})")
    text = f"{len(pending)} of {counted(len(tasks), 'recording')}, "
    text += counted(sum(estimate.frame_counts), "frame")
    if estimate.unknown_count:
        text += f" and an unknown number in {estimate.unknown_count} of them"
    if seconds := estimate.seconds_per_frame:
        workers = executor.workers
        duration = timedelta(seconds=round(estimate.frames * seconds / workers))
        cores = f"{counted(workers, 'core')}, at {1 / seconds:.0f} frames/s"
        text += f"; about {duration} on {cores}{' each' if workers > 1 else ''}"
    print(f"{text}; {failing} cannot be tracked" if failing else text)


def _print_excluded(options: argparse.Namespace, recordings: Mapping[str, PathOrUrl]) -> None:
    """Report recordings in the folder that are excluded, for want of a target or a topic."""
    reason = " without a target"
    advice = "detect targets with --detections, --detections-topic or --detector"
    if options.detections_topic:
        reason, advice = "", "only bags have topics"
    elif filter_from_options(options) is not None:
        return
    if is_url(options.archive):
        return
    # The wider filter may find two recordings of one name. Not an error here.
    with contextlib.suppress(FootageError, RecordingError):
        others = find_recordings(options.archive, any_footage()).keys() - recordings.keys()
        if others:
            count = counted(len(others), "recording")
            print(f"excluded: {count}{reason}, such as {min(others)}; {advice}")


class _TimeEstimate:
    """Counts the frames of recordings, and measures the tracking time on the first ones."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self.frame_counts: list[int] = []
        self.unknown_count = 0
        self._tracked_frames, self._tracking_seconds = 0, 0.0
        self._downloaded_frames, self._download_seconds = 0, 0.0

    @property
    def frames(self) -> float:
        """Estimated number of all frames; unknown recordings count as the mean of the others."""
        known = self.frame_counts
        mean = sum(known) / len(known) if known else 0.0
        return sum(known) + self.unknown_count * mean

    @property
    def seconds_per_frame(self) -> float:
        """Time to download and track a frame; 0 if nothing was tracked."""
        if not self._tracked_frames:
            return 0.0
        downloaded = self._downloaded_frames
        download = self._download_seconds / downloaded if downloaded else 0.0
        return self._tracking_seconds / self._tracked_frames + download

    def add(self, source: PathOrUrl) -> int | None:
        """Add a recording; return its number of frames, None if unknown.

        Raises:
            FootageError: It cannot be read.
            RecordingError: It has no target.
        """
        is_sampled = self._tracked_frames < _SAMPLED_RECORDINGS * _SAMPLED_FRAMES
        if is_url(source) and not is_sampled:
            # To count the frames, it would have to be downloaded.
            self.unknown_count += 1
            return None
        started_at = time.monotonic()
        with local_copy(source) as path, errors_name_source(source, path):
            download_seconds = time.monotonic() - started_at
            count = self._track_sample(path, _SAMPLED_FRAMES if is_sampled else 0)
        if count is None:
            self.unknown_count += 1
        else:
            self.frame_counts.append(count)
            if is_url(source):
                self._downloaded_frames += count
                self._download_seconds += download_seconds
        return count

    def _track_sample(self, path: Path, frames: int) -> int | None:
        """Track the first frames of a recording; return its number of frames, None if unknown."""
        options = self._options
        recording = open_from_options(path, options)
        with closing(make_plan(recording, options)) as plan:
            if frames:
                started_at = time.monotonic()
                with closing(plan.track()) as tracked:
                    self._tracked_frames += sum(1 for _ in islice(tracked, frames))
                self._tracking_seconds += time.monotonic() - started_at
        return recording.frame_count
