"""Which files the options of `track` ask for, and where."""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.output_folder import OutputFolder, WriterFactory, check_free
from pf_tracker_ros.recordings.plan import SIDECAR, Plan
from pf_tracker_ros.recordings.report import RecordingReport
from pf_tracker_ros.recordings.tables import COLUMNS, LABELED_COLUMNS, BoxesCsv, BoxesParquet
from pf_tracker_ros.recordings.topics import TopicBag
from pf_tracker_ros.recordings.video import AnnotatedVideo

BOXES, PARQUET, VIDEO, BAG = "boxes.csv", "boxes.parquet", "overlay.mp4", "topics.mcap"


def check_outputs(options: argparse.Namespace) -> None:
    """Refuse what `open_outputs` would refuse because it is there already, or could not write.

    Raises:
        RecordingError: A file is there, or OpenCV cannot take the name of a video.
    """
    if options.video:
        _check_video_folder(options.output)
    for folder, names in _places(options).items():
        check_free(folder, names)


def open_outputs(options: argparse.Namespace, plan: Plan, name: str) -> list[OutputFolder]:
    """Begin the files.

    Args:
        options: Of the command line.
        plan: What is tracked.
        name: What the report calls the recording.

    Raises:
        RecordingError: One is there already, or cannot be written.
    """
    makers = _makers(plan, name, str(options.seed))
    opened: list[OutputFolder] = []
    try:
        for folder, names in _places(options).items():
            opened.append(OutputFolder(folder, {each: makers[each] for each in names}))
    except BaseException:
        for outputs in opened:
            outputs.discard()
        raise
    return opened


def _check_video_folder(folder: Path) -> None:
    """Refuse a folder with whose name OpenCV would end the process."""
    name = str(folder)
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise RecordingError(
            f"--output {name!a} has a name that OpenCV cannot write a video into; give a folder "
            "whose name is UTF-8"
        ) from error


def _places(options: argparse.Namespace) -> dict[Path, list[str]]:
    """Folder to the names of the files that go there."""
    names = [BOXES]
    names += [PARQUET] if options.parquet else []
    names += [VIDEO] if options.video else []
    names += [BAG] if options.bag else []
    if options.report is None:
        return {options.output: names}
    if options.report is SIDECAR or options.report == options.output:
        return {options.output: [*names, REPORT_FILE]}
    return {options.output: names, options.report: [REPORT_FILE]}


def _makers(plan: Plan, name: str, seed: str) -> dict[str, WriterFactory]:
    """Name of each file to what begins it."""
    recording, preset, most = plan.recording, plan.summary, plan.max_targets
    columns = COLUMNS if most == 1 else LABELED_COLUMNS
    facts = {"recording": name, "preset": preset, "seed": seed}
    return {
        BOXES: functools.partial(BoxesCsv, columns=columns),
        PARQUET: functools.partial(BoxesParquet, columns=columns),
        VIDEO: functools.partial(AnnotatedVideo, frame_rate=1.0 / recording.interval),
        BAG: functools.partial(TopicBag, preset=preset, max_targets=most),
        REPORT_FILE: functools.partial(
            RecordingReport, recording=recording, preset=preset, facts=facts
        ),
    }
