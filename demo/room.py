"""The end of the demo: a rendered room whose people are located in meters.

1. `benchmarks/world_recording.py` writes a bag as of a robot with a depth camera.
2. `track --world` tracks and locates the people.
3. The view from above is taken from the report, and the positions are compared with the true ones.
"""

from __future__ import annotations

import csv
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from failure import DemoError
from geometry_msgs.msg import PoseStamped
from processes import run_command, run_to_end
from rclpy.serialization import deserialize_message

from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.footage.bags import read_topic

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
        errors: Distances from the true positions, as a sentence.
    """

    name: str
    view_from_above: str
    commands: Mapping[str, list[str]]
    errors: str


def write_recording(folder: Path) -> None:
    """Write the bag.

    Raises:
        DemoError: It cannot be written.
    """
    command = [sys.executable, *_recording_arguments(folder)]
    run_command(command, folder / "log" / "recording.log")


def locate(folder: Path) -> RoomResult:
    """Track and locate the people of the bag.

    Raises:
        DemoError: It failed.
        FootageError: The bag of the results cannot be read.
    """
    tracked = folder / "tracked"
    run_to_end("track", _track_arguments(folder), folder / "log" / "track.log")
    page = (tracked / REPORT_FILE).read_text(encoding="utf-8")
    found = re.search(r"From above.*?(<svg.*?</svg>)", page, re.DOTALL)
    if found is None:
        raise DemoError(f"{tracked / REPORT_FILE} has no view from above")
    commands = {
        "the bag": ["python", *_recording_arguments(folder)],
        "report, boxes.csv and topics.mcap": ["track", *_track_arguments(folder)],
    }
    return RoomResult(NAME, found[1], commands, errors_in_words(folder))


def errors_in_words(folder: Path) -> str:
    """The distances between the located and the true positions, as a sentence.

    Raises:
        FootageError: The bag cannot be read.
    """
    truth = {
        number: {
            stamp: deserialize_message(message, PoseStamped).pose.position
            for stamp, message in read_topic(folder / "input.mcap", f"/truth/walker_{number}")
        }
        for number in (1, 2)
    }
    distances = []
    with (folder / "tracked" / "boxes.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            true = truth.get(int(row["id"] or 0), {}).get(int(row["stamp"]))
            if true is not None and row["position_x"]:
                found = float(row["position_x"]), float(row["position_y"])
                distances.append(math.dist(found, (true.x, true.y)))
    if not distances:
        return f"{NAME}: no position has a true one to compare with"
    middle, most = np.percentile(distances, (50, 90))
    return (
        f"{NAME}: positions are {middle:.2f} m off the true ones in the median, 90 % less than "
        f"{most:.2f} m"
    )


def _recording_arguments(folder: Path) -> list[str]:
    bag = folder / "input.mcap"
    return [str(_GENERATOR), str(bag), "--frames", str(_FRAMES), "--rate", str(_RATE)]


def _track_arguments(folder: Path) -> list[str]:
    arguments = [str(folder / "input.mcap"), "--bag-topic", _IMAGES, "--world"]
    arguments += [f"--parameter={name}={value}" for name, value in _MOUNTING.items()]
    return [*arguments, "--output", str(folder / "tracked"), "--bag", "--video", "--report"]
