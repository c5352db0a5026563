"""The output files of `track`, from its options."""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.keyframes.summary import FRAMES_TO_CHECK, FramesToCheck
from pf_tracker_ros.recordings.label_files import LabelFile, label_files
from pf_tracker_ros.recordings.output_folder import OutputFolder, WriterFactory, check_free
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
from pf_tracker_ros.recordings.video import AnnotatedVideo

BOXES, PARQUET, VIDEO, BAG = "boxes.csv", "boxes.parquet", "overlay.mp4", "topics.mcap"


def check_outputs(options: argparse.Namespace) -> None:
    """Check that the files can be created, before anything is tracked.

    Raises:
        RecordingError: A file exists, or OpenCV does not support the name of the folder.
    """
    if options.video:
        _check_video_folder(options.output)
    for folder, names in _output_files(options).items():
        check_free(folder, names)


def open_outputs(options: argparse.Namespace, plan: Plan, name: str) -> list[OutputFolder]:
    """Open the files for writing.

    Raises:
        RecordingError: A file exists, or cannot be written.
    """
    factories = _writer_factories(plan, name, options)
    opened: list[OutputFolder] = []
    try:
        for folder, names in _output_files(options).items():
            opened.append(OutputFolder(folder, {each: factories[each] for each in names}))
    except BaseException:
        for outputs in opened:
            outputs.discard()
        raise
    return opened


def _check_video_folder(folder: Path) -> None:
    """Reject a name that is not UTF-8: OpenCV's writer would abort the process."""
    name = str(folder)
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise RecordingError(
            f"OpenCV cannot write a video into --output {name!a}; give a folder with a UTF-8 name"
        ) from error


def _output_files(options: argparse.Namespace) -> dict[Path, list[str]]:
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
        ),
        FRAMES_TO_CHECK: FramesToCheck,
        **{
            file: functools.partial(LabelFile, name=recording.path.name, write_tracks=write)
            for file, write in labels.items()
        },
    }
