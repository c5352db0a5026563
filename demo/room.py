"""The end of the demo: a rendered room whose people are located in meters.

1. `benchmarks/world_recording.py` writes a bag as of a robot with a depth camera.
2. `track --world` tracks and locates the people.
3. The overlays become a video, and the view from above is taken from the report.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from failure import DemoError
from processes import run_command, run_to_end
from report import write_videos

from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.footage.bags import read_topic
from pf_tracker_ros.footage.cdr import deserialize_image
from pf_tracker_ros.recordings.topics import NODE

NAME = "room"
_RATE, _FRAMES = 10, 80
_GENERATOR = Path(__file__).resolve().parents[1] / "benchmarks" / "world_recording.py"
_IMAGES = "/camera/image_raw"
_MOUNTING = {"camera.height": 1.2, "camera.pitch": 0.05}


@dataclass(frozen=True)
class RoomResult:
    """The located room.

    Attributes:
        name: Name of its folder.
        view_from_above: SVG, in the colors of the reports.
        commands: What a command makes, to its arguments.
    """

    name: str
    view_from_above: str
    commands: Mapping[str, list[str]]


def write_recording(folder: Path) -> None:
    """Write the bag.

    Raises:
        DemoError: It cannot be written.
    """
    command = [sys.executable, *_recording_arguments(folder)]
    run_command(command, folder / "log" / "recording.log")


def locate(folder: Path) -> RoomResult:
    """Track and locate the people of the bag, and write the video.

    Raises:
        DemoError: It failed.
        FootageError: The bag of the results cannot be read.
    """
    tracked = folder / "tracked"
    run_to_end("track", _track_arguments(folder), folder / "log" / "track.log")
    overlays = [
        decode_raw(deserialize_image(message))
        for _, message in read_topic(tracked / "topics.mcap", f"{NODE}/overlay")
    ]
    write_videos(overlays, _RATE, folder)
    page = (tracked / REPORT_FILE).read_text(encoding="utf-8")
    found = re.search(r"From above.*?(<svg.*?</svg>)", page, re.DOTALL)
    if found is None:
        raise DemoError(f"{tracked / REPORT_FILE} has no view from above")
    commands = {
        "the bag": ["python", *_recording_arguments(folder)],
        "report, boxes.csv and topics.mcap": ["track", *_track_arguments(folder)],
    }
    return RoomResult(NAME, found[1], commands)


def _recording_arguments(folder: Path) -> list[str]:
    bag = folder / "input.mcap"
    return [str(_GENERATOR), str(bag), "--frames", str(_FRAMES), "--rate", str(_RATE)]


def _track_arguments(folder: Path) -> list[str]:
    arguments = [str(folder / "input.mcap"), "--bag-topic", _IMAGES, "--world"]
    arguments += [f"--parameter={name}={value}" for name, value in _MOUNTING.items()]
    return [*arguments, "--output", str(folder / "tracked"), "--bag", "--report"]
