"""The command `track --archive`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from datetime import timedelta
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from pf_tracker_ros.evaluation.command_line import parse_parameters
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE, fill
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.archive import (
    ArchiveEntry,
    ArchiveTask,
    alone_in,
    done_entry,
    find_recordings,
    make_tasks,
    run_tasks,
    write_manifest,
    write_whole,
)
from pf_tracker_ros.recordings.command_line import BESIDE
from pf_tracker_ros.recordings.errors import DONE, FAILED, RecordingError
from pf_tracker_ros.recordings.progress import progress_bar
from pf_tracker_ros.recordings.recording import open_recording
from pf_tracker_ros.recordings.target import choose_target
from pf_tracker_ros.recordings.tracking import track_recording

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
    for option in ("source", "box"):
        if getattr(options, option) is not None:
            raise RecordingError(f"{option} is for one recording; allowed: without --archive")
    if options.report not in (None, BESIDE):
        raise RecordingError("--report has no folder here; allowed: beside each boxes.csv")
    output = options.output.absolute()
    tasks = make_tasks(find_recordings(options.archive), output, _arguments(options))
    if options.dry_run:
        _print_plan(tasks, options)
        return DONE
    with alone_in(output):
        found = {task.name: done_entry(task) for task in tasks}
        waiting = [task for task in tasks if found[task.name] is None]
        try:
            with (
                progress_bar(options.archive.name, len(waiting), "recordings") as advance,
                closing(run_tasks(waiting, options.jobs)) as done,
            ):
                for task, entry in done:
                    found[task.name] = entry
                    if entry.error:
                        print(f"track: error: {entry.error}", file=sys.stderr)
                    advance()
        finally:
            # One may be done of which its process could not tell any more.
            told = {task.name: found[task.name] or done_entry(task) for task in tasks}
            known = {name: entry for name, entry in told.items() if entry is not None}
            write_manifest(output, known)
        if options.report is not None:
            _write_report([known[task.name] for task in tasks], options, output)
    _print_table([known[task.name] for task in tasks], len(waiting), output)
    return FAILED if any(entry.error for entry in known.values()) else DONE


def _arguments(options: argparse.Namespace) -> list[str]:
    """The arguments of `track` that are the same for every recording."""
    arguments = [f"--preset={options.preset}", f"--seed={options.seed}"]
    arguments += [f"--parameter={each}" for each in options.parameter]
    arguments += [f"--frame-rate={options.frame_rate}"]
    if options.bag_topic:
        arguments.append(f"--bag-topic={options.bag_topic}")
    arguments += [f"--{flag}" for flag in ("video", "parquet", "bag") if getattr(options, flag)]
    return arguments + (["--report"] if options.report is not None else [])


def _write_report(found: Sequence[ArchiveEntry], options: argparse.Namespace, output: Path) -> None:
    frames = sum(entry.frames for entry in found)
    failed = sum(bool(entry.error) for entry in found)
    page = fill(
        "archive.html.jinja",
        title=f"{options.archive.name}, tracked",
        facts={
            "archive": str(options.archive),
            "preset": options.preset,
            "parameters": ", ".join(options.parameter) or "those of the preset",
            "recordings": f"{len(found)}, of which {failed} failed",
            "frames": str(frames),
        },
        # What needs to be looked at comes first.
        rows=[
            {
                "name": entry.name,
                "address": quote(f"{entry.name}/{REPORT_FILE}"),
                "frames": entry.frames,
                "states": entry.states,
                "error": entry.error,
            }
            for entry in sorted(found, key=lambda entry: not entry.error)
        ],
    )
    write_whole(output / REPORT_FILE, page)


def _print_table(entries: Sequence[ArchiveEntry], tracked: int, output: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table()
    table.add_column("recording", overflow="fold")
    for heading in ("frames", "tracking", "occluded", "lost"):
        table.add_column(heading, justify="right")
    table.add_column("", overflow="fold")
    for entry in entries:
        shares = [
            f"{entry.states.get(state, 0) / entry.frames:.0%}" if entry.frames else ""
            for state in ("tracking", "occluded", "lost")
        ]
        frames = str(entry.frames) if entry.frames else ""
        # Names go in as Text: square brackets in a plain string are markup to Rich.
        table.add_row(Text(entry.name), frames, *shares, Text(entry.error))
    Console().print(table)
    failed = sum(bool(entry.error) for entry in entries)
    print(
        f"{len(entries)} recordings: {tracked - failed} tracked, {len(entries) - tracked} done "
        f"before, {failed} failed; results in {output}"
    )


def _print_plan(tasks: Sequence[ArchiveTask], options: argparse.Namespace) -> None:
    """What would be done, and how long it would take, from a sample."""
    frames = unknown = sampled = 0
    seconds = 0.0
    parameters = parse_parameters(options.parameter)
    waiting = [task for task in tasks if done_entry(task) is None]
    for task in waiting:
        try:
            recording = open_recording(
                task.source, bag_topic=options.bag_topic, frame_rate=options.frame_rate
            )
            target = choose_target(recording, None)
            if sampled < _SAMPLED_RECORDINGS * _SAMPLED_FRAMES:
                began = time.monotonic()
                sample = track_recording(
                    recording, target, options.preset, parameters, options.seed
                )
                with closing(sample) as tracked:
                    sampled += sum(1 for _ in islice(tracked, _SAMPLED_FRAMES))
                seconds += time.monotonic() - began
        except (FootageError, RecordingError) as error:
            print(f"would fail: {error}")
            continue
        count = recording.frame_count
        frames, unknown = frames + (count or 0), unknown + (count is None)
        print(f"would track: {task.source} ({count or 'an unknown number of'} frames)")
    text = f"{len(waiting)} of {len(tasks)} recordings, {frames} frames"
    if unknown:
        text += f" and those of {unknown} that do not tell"
    if sampled:
        left = timedelta(seconds=round(frames * seconds / sampled / options.jobs))
        text += (
            f"; about {left} on {options.jobs} processes, at {sampled / seconds:.0f} frames/s each"
        )
    print(text)
