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
from pf_tracker_ros.evaluation.command_line import add_tracker_options, positive
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE
from pf_tracker_ros.recordings import errors
from pf_tracker_ros.recordings.archives.stores import parse_path_or_url
from pf_tracker_ros.recordings.plan import SIDECAR
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

_DESCRIPTION = """\
Track a target, or several, through a recording, without a ROS graph: a bag, a video, a folder of
images or a sequence folder in, boxes.csv and what else is asked for out. The boxes are those that
the node publishes for a replay of the recording in lockstep, to the bit.

The target is that of --box, or is drawn with --draw, else that of the file SOURCE.target.yaml
beside the recording (for drive.mcap that is drive.target.yaml), else the first box of the
recording's ground truth. Where the parameter max_targets is not given, it is 1 for one target, and
32 for several and for what a detector finds.
"""

_EXIT_CODES = f"""\
boxes.csv has a row a frame: frame (from 0), stamp (ns), id, x, y, width, height (px; empty while
there is no box), state and confidence (0 to 1), in full precision. With max_targets above 1 each
target has a row in a frame, with its label in a last column, and a frame without any one row
without an id.

exit codes:
  {errors.DONE}    all went well
  {errors.FAILED}    a file could not be written, for another reason than those below
  {errors.REFUSED}    the request cannot be carried out; nothing was tracked
  {errors.UNREADABLE_SOURCE}    the recording cannot be read, or not to its end
  {errors.OUTPUT_EXISTS}    an output exists already; nothing was tracked
  {errors.NO_PERMISSION}    this user may not write there
  {errors.DISK_FULL}    the disk is full
  {errors.WRONG_TARGET}    the target is refused, or its file is wrong or of another recording
  {errors.WRONG_DETECTIONS}    the detections cannot be read, are wrong or of another recording
  {errors.INTERRUPTED}  interrupted (Ctrl-C); the second time at once, without finishing the files
  {errors.TERMINATED}  terminated

Where the work ends early, the files hold the frames up to there, and are whole.
"""


class _Parser(Parser):
    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            # argparse takes a box that begins left of the image for an option.
            message += "; one that begins with '-' comes behind '=', such as --box=-3,4,50,60"
        super().error(message)


def parser() -> argparse.ArgumentParser:
    """The parser of the command line, which refuses in one line."""
    parser = _Parser("track", description=_DESCRIPTION, epilog=_EXIT_CODES)
    parser.add_argument(
        "source",
        nargs="?",
        metavar="SOURCE",
        help="a rosbag2 folder or .mcap file, a video, a folder of images or a sequence folder; or "
        "the URL of one, of which a copy is made (needs fsspec)",
    )
    parser.add_argument(
        "--output",
        type=parse_path_or_url,
        required=True,
        metavar="DIR",
        help="folder for boxes.csv and the rest, made where it is missing; for an archive also a "
        "place in an object store, such as s3://bucket/boxes (needs fsspec)",
    )
    parser.add_argument(
        "--box",
        type=_box,
        action="append",
        metavar="X,Y,W,H",
        help="the target in the first frame, in pixels; may be repeated for several targets",
    )
    parser.add_argument(
        "--draw",
        action="store_true",
        help="draw the target, or several, on a page that is served on this machine's loopback "
        "(needs aiohttp)",
    )
    _add_detections(parser)
    add_tracker_options(parser)
    parser.add_argument("--seed", type=_seed, metavar="N", help="as the node's (default: 0)")
    parser.add_argument(
        "--video", action="store_true", help="write overlay.mp4: what ~/overlay shows"
    )
    parser.add_argument(
        "--parquet", action="store_true", help="write boxes.parquet too (needs pyarrow)"
    )
    parser.add_argument(
        "--bag",
        action="store_true",
        help="write topics.mcap: ~/box, ~/boxes where max_targets is above 1, ~/status, "
        "~/particles and ~/overlay, to play beside the recording (needs rosbags)",
    )
    parser.add_argument(
        "--report",
        type=Path,
        nargs="?",
        const=SIDECAR,
        metavar="DIR",
        help="write report.html: plots and pictures on one page, into DIR or beside boxes.csv "
        "(needs Matplotlib and Jinja2)",
    )
    parser.add_argument(
        "--bag-topic", default="", metavar="TOPIC", help="image topic of a bag that has several"
    )
    parser.add_argument(
        "--frame-rate",
        type=_rate,
        metavar="HZ",
        help=f"of a folder of images, which does not tell (default: {DEFAULT_FRAME_RATE:g})",
    )
    parser.add_argument(
        "--archive",
        type=parse_path_or_url,
        metavar="FOLDER_OR_LIST",
        help="track every recording below a folder that has its target file beside it or is a "
        "sequence (with detections or a detector every one), or those that a text file lists "
        "(paths and URLs), into a folder each; what is done of the same inputs, version and "
        "parameters is not done again",
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        metavar="N",
        help="recordings of an archive at once, each on a core of its own (default: 1, on Ray as "
        "many as the cluster has cores for)",
    )
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="spread an archive over a Ray cluster: auto or HOST:PORT of one that is running, or "
        "local to start one on this machine (needs ray)",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="say what would be done for an archive, and how long it would take, from a sample",
    )
    return parser


def _add_detections(parser: argparse.ArgumentParser) -> None:
    """Where detections come from; any of it needs SciPy."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--detections",
        type=Path,
        nargs="?",
        const=SIDECAR,
        metavar="FILE",
        help="a detector's boxes, which start, confirm and correct targets: lines frame,id,x,y,"
        "width,height,score[,label] with frame, x and y counted from 1, as of the MOT challenge; "
        "without FILE, and for an archive, SOURCE.detections.csv beside each recording",
    )
    group.add_argument(
        "--detections-topic",
        metavar="TOPIC",
        help="the same from a topic of the bag, of vision_msgs/Detection2DArray, as recorded",
    )
    group.add_argument(
        "--detector",
        choices=tuple(DETECTORS),
        help="the same by the node's built-in detector, which here has all the time that it takes",
    )
    parser.add_argument(
        "--detector-rate",
        type=functools.partial(_rate, most=100.0),
        default=1.0,
        metavar="HZ",
        help="most frames in a second of the recording that it looks at (default: %(default)g); "
        f"motion is cheap enough for 5, and learns the background from its first {UPDATE_EVERY}",
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


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: whole numbers from 0 to 2147483647")
    return int(text)


def _rate(text: str, most: float = 10_000.0) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0.01 <= rate <= most:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: 0.01 to {most:g}")
    return rate
