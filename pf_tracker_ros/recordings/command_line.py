"""The command line of `track`."""

from __future__ import annotations

import argparse
import functools
import math
from pathlib import Path
from typing import NoReturn

from pf_tracker_ros.background import UPDATE_EVERY
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.command_lines import Parser
from pf_tracker_ros.evaluation.command_line import add_tracker_options, positive, seed
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.recordings import errors
from pf_tracker_ros.recordings.archives.stores import parse_path_or_url
from pf_tracker_ros.recordings.label_files import FORMAT_NAMES
from pf_tracker_ros.recordings.plan import SIDECAR
from pf_tracker_ros.recordings.positions import SENSORS
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

_DESCRIPTION = """\
Track targets through a recording, without ROS. A recording is a ROS 2 bag, a video, a folder of
images or a sequence folder. The boxes are written to boxes.csv in the output folder. They equal
the boxes of the node in a lockstep replay, to the bit.

The target is the first of these:
  1. the box of --box, or the one drawn with --draw
  2. the box in the target file beside the recording: drive.target.yaml for drive.mcap
  3. the first box of the recording's ground truth, unless a detector is used
With a detector, a target is optional. The default of max_targets is 32 with a detector or several
targets, else 1.
"""

_EPILOG = f"""\
example:
  track drive.mcap --box 293,97,115,82 --video --output results

boxes.csv:
  One row per frame and target, with the columns frame (counted from 0), stamp (ns), id, x, y,
  width, height (px), state and confidence (0 to 1), and label where max_targets is above 1. The
  box is empty while the target is lost. A frame without targets has one row. With --world there
  are also position_x, position_y (m), velocity_x, velocity_y (m/s), their covariances
  covariance_xx, ... and velocity_covariance_xx, ..., and the method of this frame's measurement.

exit codes:
  {errors.DONE}    success
  {errors.FAILED}    a file cannot be written, or a recording of the archive failed
  {errors.REFUSED}    the request is invalid; nothing was tracked
  {errors.UNREADABLE_SOURCE}    the recording cannot be read, or only in part
  {errors.OUTPUT_EXISTS}    an output exists already; nothing was tracked
  {errors.NO_PERMISSION}    no permission to write to the output folder
  {errors.DISK_FULL}    the disk is full
  {errors.WRONG_TARGET}    the target or its file is invalid, or belongs to another recording
  {errors.WRONG_DETECTIONS}    the detections are invalid, or belong to another recording
  {errors.FILES_KEPT}    files added to the results of an archive, or changed there, were kept
  {errors.INTERRUPTED}  interrupted (Ctrl-C, which for a camera is success); a second Ctrl-C
       discards the unfinished files
  {errors.TERMINATED}  terminated (SIGTERM)

If tracking ends early, the files are complete up to the last tracked frame.
"""


class _Parser(Parser):
    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            # argparse takes a box with a negative x for an option.
            message += "; write a value that begins with '-' after '=', such as --box=-3,4,50,60"
        super().error(message)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line. Its errors are one line long."""
    parser = _Parser("track", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument(
        "source",
        nargs="?",
        metavar="SOURCE",
        help="recording: a rosbag2 folder or .mcap file, a video, a folder of images, a sequence "
        "folder, or the URL of one of these (needs fsspec); or a camera: its number, such as 0, or "
        "its address, rtsp://...",
    )
    parser.add_argument(
        "--output",
        type=parse_path_or_url,
        required=True,
        metavar="DIR",
        help="folder for boxes.csv and the other files, created if missing; for an archive also "
        "the URL of an object store, such as s3://bucket/boxes (needs fsspec)",
    )
    parser.add_argument(
        "--bag-topic", default="", metavar="TOPIC", help="image topic, if the bag has several"
    )
    parser.add_argument(
        "--as-recorded",
        action="store_true",
        help="keep the images of a bag in the order of recording, as the node receives them; by "
        "default they are sorted by their stamps",
    )
    parser.add_argument(
        "--allow-partial",
        action="store_true",
        help="exit with 0 although a damaged recording could be read only in part; its damage is "
        "then a warning",
    )
    parser.add_argument(
        "--frame-rate",
        type=_rate,
        metavar="HZ",
        help=f"frame rate of a folder of images (default: {DEFAULT_FRAME_RATE:g})",
    )
    add_tracker_options(parser)
    parser.add_argument(
        "--seed", type=seed, metavar="N", help="seed of the tracker's random numbers (default: 0)"
    )
    targets = parser.add_argument_group("target")
    targets.add_argument(
        "--box",
        type=_box,
        action="append",
        metavar="X,Y,W,H",
        help="the target in the first frame, in pixels; repeat it for several targets",
    )
    targets.add_argument(
        "--draw",
        action="store_true",
        help="draw the targets on a web page, served on this machine only (needs aiohttp)",
    )
    targets.add_argument(
        "--keyframes",
        type=Path,
        nargs="?",
        const=SIDECAR,
        metavar="FILE",
        help="boxes at several frames, met exactly; between them, the targets are tracked forward "
        "and backward. FILE is a target file, boxes.csv, or a file in a format of --format "
        "(default FILE: drive.target.yaml beside drive.mcap)",
    )
    _add_detections(parser)
    _add_positions(parser)
    _add_outputs(parser)
    _add_archives(parser)
    return parser


def _add_detections(parser: argparse.ArgumentParser) -> None:
    detections = parser.add_argument_group(
        "detector", "Detections start, confirm and correct targets (needs SciPy)."
    )
    sources = detections.add_mutually_exclusive_group()
    sources.add_argument(
        "--detections",
        type=Path,
        nargs="?",
        const=SIDECAR,
        metavar="FILE",
        help="text file in the format of the MOT challenge, with lines frame,id,x,y,width,height,"
        "score[,label] and frame, x and y counted from 1 (default FILE: drive.detections.csv "
        "beside drive.mcap; an archive always uses this)",
    )
    sources.add_argument(
        "--detections-topic",
        metavar="TOPIC",
        help="topic of the bag, of type vision_msgs/Detection2DArray",
    )
    sources.add_argument("--detector", choices=tuple(DETECTORS), help="built-in detector to run")
    detections.add_argument(
        "--detector-rate",
        type=functools.partial(_rate, highest=100.0),
        default=1.0,
        metavar="HZ",
        help="frames per second of the recording that the built-in detector processes at most "
        "(default: %(default)g); 5 suits motion, which learns the background from its first "
        f"{UPDATE_EVERY} frames",
    )


def _add_positions(parser: argparse.ArgumentParser) -> None:
    positions = parser.add_argument_group(
        "positions in meters",
        "As the node localizer has them. --parameter and --params-file take its parameters, too,\n"
        "such as --parameter camera.height=1.2.",
    )
    positions.add_argument(
        "--world",
        action="store_true",
        help="locate the targets of a bag with CameraInfo: further columns in boxes.csv, the "
        "localizer's topics in topics.mcap, and a view from above in the report",
    )
    positions.add_argument(
        "--world-topic",
        type=_sensor_topic,
        action="append",
        default=[],
        metavar="SENSOR=TOPIC",
        help=f"topic of {', '.join(SENSORS[:-1])} or {SENSORS[-1]}, if the bag has several; empty "
        "for none; may be repeated",
    )


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    outputs = parser.add_argument_group("further outputs")
    outputs.add_argument(
        "--video",
        action="store_true",
        help="write overlay.mp4, the recording with the targets drawn in, as on ~/overlay",
    )
    outputs.add_argument(
        "--parquet",
        action="store_true",
        help="write boxes.parquet with the same rows (needs pyarrow)",
    )
    outputs.add_argument(
        "--format",
        type=_formats,
        default=(),
        metavar="NAME[,NAME...]",
        help="write the boxes in further formats: mot (boxes.mot.txt), coco (boxes.coco.json), "
        "cvat (boxes.cvat.xml, CVAT for video 1.1), kitti (boxes.kitti.txt), target "
        "(boxes.target.yaml, a target file with keyframes), yolo (boxes.yolo.zip)",
    )
    outputs.add_argument(
        "--bag",
        action="store_true",
        help="write topics.mcap with ~/box, ~/status, ~/particles, ~/overlay and, if max_targets "
        "is above 1, ~/boxes, for playback with the recording (needs rosbags)",
    )
    outputs.add_argument(
        "--report",
        type=Path,
        nargs="?",
        const=SIDECAR,
        metavar="DIR",
        help="write report.html, a page with plots and images (default DIR: that of boxes.csv; "
        "needs Matplotlib and Jinja2)",
    )


def _add_archives(parser: argparse.ArgumentParser) -> None:
    archives = parser.add_argument_group("archive", "Track many recordings, each into its folder.")
    archives.add_argument(
        "--archive",
        type=parse_path_or_url,
        metavar="FOLDER_OR_LIST",
        help="track every recording with a target file or ground truth in a folder tree (with a "
        "detector: every recording), or every path or URL listed in a text file; recordings whose "
        "results are up to date are skipped",
    )
    archives.add_argument(
        "--jobs",
        type=positive,
        metavar="N",
        help="recordings tracked in parallel (default: 1; with --ray: one per core)",
    )
    archives.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="distribute the recordings over a Ray cluster: auto or HOST:PORT of a running "
        "cluster, or local to start one on this machine (needs ray)",
    )
    archives.add_argument(
        "--dry-run",
        action="store_true",
        help="list the recordings to track and estimate the time, without writing anything",
    )


def _box(text: str) -> Box:
    try:
        x, y, width, height = (float(part) for part in text.strip("[]() ").split(","))
    except ValueError:
        x = y = width = height = math.nan
    if not all(map(math.isfinite, (x, y, width, height))) or min(width, height) <= 0:
        raise argparse.ArgumentTypeError(
            f"{text!r}; allowed: x,y,width,height in pixels, width and height above 0"
        )
    return x, y, width, height


def _sensor_topic(text: str) -> tuple[str, str]:
    sensor, equals, topic = (part.strip() for part in text.partition("="))
    if not equals or sensor not in SENSORS:
        raise argparse.ArgumentTypeError(
            f"{text!r}; allowed: SENSOR=TOPIC, with SENSOR one of {', '.join(SENSORS)}"
        )
    return sensor, topic


def _formats(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if unknown := [name for name in names if name not in FORMAT_NAMES]:
        raise argparse.ArgumentTypeError(
            f"{unknown[0]!r}; allowed: {', '.join(FORMAT_NAMES)}, separated by commas"
        )
    return names


def _rate(text: str, highest: float = 10_000.0) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0.01 <= rate <= highest:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: 0.01 to {highest:g}")
    return rate
