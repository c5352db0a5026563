"""The output files of `track`, from its options.

They are written in a hidden folder and moved into place when complete. If tracking ends early, the
files are complete up to the last tracked frame.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

from pf_tracker_ros.atomic_files import flush_to_disk, hidden_folder, move_without_overwriting
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.footage.access import is_folder, resolved
from pf_tracker_ros.recordings.errors import OUTPUT_EXISTS, RecordingError, unwritable
from pf_tracker_ros.recordings.keyframes.summary import FRAMES_TO_CHECK, FramesToCheck
from pf_tracker_ros.recordings.label_files import LabelFile, label_files
from pf_tracker_ros.recordings.plan import SIDECAR, Plan
from pf_tracker_ros.recordings.report import RecordingReport
from pf_tracker_ros.recordings.tables import (
    COLUMNS,
    LABELED_COLUMNS,
    POSITION_COLUMNS,
    BoxesCsv,
    BoxesParquet,
)
from pf_tracker_ros.recordings.topics import TopicBag
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.recordings.video import AnnotatedVideo


class FrameWriter(Protocol):
    """Writes one output file, frame by frame.

    Attributes:
        note: What is unusual in the file, as a sentence, or empty.
    """

    note: str

    def write(self, tracked: TrackedFrame) -> None:
        """Write one frame."""

    def close(self) -> None:
        """Complete the file."""

    def discard(self) -> None:
        """Release all resources; the file may stay incomplete."""


WriterFactory = Callable[[Path], FrameWriter]
"""Makes the writer of a new file at a path."""


class OutputFolder:
    """Writes several files in a hidden folder, and moves them into place on `close`.

    Attributes:
        notes: After `close`: what is unusual in a file, a sentence each.

    Args:
        folder: Final folder of the files; created if missing.
        factories: Name of each file to the factory of its writer.

    Raises:
        RecordingError: A file exists, or cannot be written.
    """

    def __init__(self, folder: Path, factories: dict[str, WriterFactory]) -> None:
        self._folder = folder
        check_free(folder, factories)
        self.notes: list[str] = []
        self._writers: dict[str, FrameWriter] = {}
        self._cleanup = ExitStack()
        try:
            for each in reversed([folder, *folder.parents]):
                if not each.exists():
                    each.mkdir(exist_ok=True)
                    self._cleanup.callback(_remove_empty, each)
            self._staging_folder = self._cleanup.enter_context(hidden_folder(folder, ".track_"))
            for name, make_writer in factories.items():
                self._writers[name] = make_writer(self._staging_folder / name)
        except OSError as error:
            self.discard()
            raise unwritable(folder, error) from error
        except BaseException:
            self.discard()
            raise

    def write(self, tracked: TrackedFrame) -> None:
        """Write a frame into every file.

        Raises:
            RecordingError: A file cannot be written.
        """
        for name, writer in self._writers.items():
            try:
                writer.write(tracked)
            except OSError as error:
                raise unwritable(self._folder / name, error) from error

    def close(self) -> list[RecordingError]:
        """Complete the files and move them into place.

        Returns:
            The errors of the files that could not be completed or moved.
        """
        failures: list[RecordingError] = []
        for name, writer in self._writers.items():
            path = self._folder / name
            try:
                writer.close()
                flush_to_disk(self._staging_folder / name)
                move_without_overwriting(self._staging_folder / name, path)
                self.notes += [writer.note] if writer.note else []
            except FileExistsError:
                failures.append(_exists_error(path))
            except OSError as error:
                failures.append(unwritable(path, error))
            except RecordingError as error:
                failures.append(error)
        self._writers = {}
        self.discard()
        return failures

    def discard(self) -> None:
        """Remove everything that was not moved into place."""
        for writer in self._writers.values():
            # The error that led here is reported instead.
            with contextlib.suppress(Exception):
                writer.discard()
        self._writers = {}
        self._cleanup.close()


def check_free(folder: Path, names: Iterable[str]) -> None:
    """Check that files can be created in a folder.

    Raises:
        RecordingError: A file exists, or the path is not a folder.
    """
    try:
        if os.path.lexists(folder) and not folder.is_dir():
            raise RecordingError(f"{folder} is not a folder; give another one", OUTPUT_EXISTS)
        for name in names:
            if os.path.lexists(folder / name):
                raise _exists_error(folder / name)
    except OSError as error:
        raise unwritable(folder, error) from error


def _exists_error(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} exists already and is not overwritten; remove it, or give another folder",
        OUTPUT_EXISTS,
    )


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


BOXES, PARQUET, VIDEO, BAG = "boxes.csv", "boxes.parquet", "overlay.mp4", "topics.mcap"


def check_outputs(options: argparse.Namespace, source: Path | str) -> None:
    """Check that the files can be created, before anything is tracked.

    Args:
        options: Of the command line.
        source: The recording, or a camera.

    Raises:
        RecordingError: A file exists, a folder is in the recording, or a video cannot be written
            into the folder.
    """
    if options.video:
        _check_video_folder(options.output)
    recording = source if isinstance(source, Path) and is_folder(source) else None
    for folder, names in output_files(options).items():
        if recording and resolved(folder).is_relative_to(resolved(recording)):
            raise RecordingError(
                f"the output {folder} is in the recording {source}, which could not be read any "
                "more; give a folder outside it"
            )
        check_free(folder, names)


def open_outputs(options: argparse.Namespace, plan: Plan, name: str) -> list[OutputFolder]:
    """Open the files for writing.

    Raises:
        RecordingError: A file exists, or cannot be written.
    """
    factories = _writer_factories(plan, name, options)
    opened: list[OutputFolder] = []
    try:
        for folder, names in output_files(options).items():
            opened.append(OutputFolder(folder, {each: factories[each] for each in names}))
    except BaseException:
        for outputs in opened:
            outputs.discard()
        raise
    return opened


def _check_video_folder(folder: Path) -> None:
    """Reject a name that is not UTF-8, which FFmpeg needs; OpenCV would abort the process."""
    name = str(folder)
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise RecordingError(
            f"--video cannot write into --output {name!a}; give a folder with a UTF-8 name"
        ) from error


def output_files(options: argparse.Namespace) -> dict[Path, list[str]]:
    """Folder to the names of its files."""
    names = [BOXES]
    names += [PARQUET] if options.parquet else []
    names += [VIDEO] if options.video else []
    names += [BAG] if options.bag else []
    names += label_files(options.format)
    names += [FRAMES_TO_CHECK] if options.keyframes is not None else []
    if options.report is None:
        return {options.output: names}
    if options.report is SIDECAR or options.report == options.output:
        return {options.output: [*names, REPORT_FILE]}
    return {options.output: names, options.report: [REPORT_FILE]}


def report_folder(options: argparse.Namespace) -> Path:
    """The folder of the report."""
    is_beside = options.report is None or options.report is SIDECAR
    return options.output if is_beside else options.report


def _video_address(options: argparse.Namespace) -> str:
    """Address of the video, relative to the report."""
    return quote(os.path.relpath(options.output / VIDEO, report_folder(options)))


def _writer_factories(
    plan: Plan, name: str, options: argparse.Namespace
) -> dict[str, WriterFactory]:
    """Name of each file to the factory of its writer."""
    recording, preset, max_targets = plan.recording, plan.summary, plan.max_targets
    columns: tuple[str, ...] = COLUMNS if max_targets == 1 else LABELED_COLUMNS
    localizer = plan.positions.parameters if plan.positions else None
    if localizer:
        columns += POSITION_COLUMNS
    facts = {"recording": name, "preset": preset, "seed": str(options.seed)}
    labels = label_files(options.format)
    return {
        BOXES: functools.partial(BoxesCsv, columns=columns),
        PARQUET: functools.partial(BoxesParquet, columns=columns),
        VIDEO: functools.partial(AnnotatedVideo, frame_rate=1.0 / recording.interval),
        BAG: functools.partial(
            TopicBag, preset=preset, max_targets=max_targets, localizer=localizer
        ),
        REPORT_FILE: functools.partial(
            RecordingReport,
            recording=recording,
            preset=preset,
            facts=facts,
            fixed_frame=localizer.fixed_frame if localizer else "",
            video=_video_address(options) if options.video else "",
        ),
        FRAMES_TO_CHECK: FramesToCheck,
        **{
            file: functools.partial(LabelFile, name=recording.path.name, write_tracks=write)
            for file, write in labels.items()
        },
    }
