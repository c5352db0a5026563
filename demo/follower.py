"""The end of the demo: a robot that follows a person through a drawn room, in a closed loop.

1. `benchmarks/follow_parts` draws the room. In each frame, tracker and localizer find the person,
   and the robot drives by the pose that they publish.
2. The camera's image and a map become a video, in two shapes, and the sensors' messages a bag.
3. `track --world` locates the person in the bag, and writes the report.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from failure import DemoError
from matplotlib.font_manager import findfont
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from processes import run_to_end

from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.footage.bag_writing import BagWriter
from pf_tracker_ros.footage.video_encoding import open_encoder
from pf_tracker_ros.messages import IMAGE_TYPE, image_message
from pf_tracker_ros.overlay import STATE_COLORS, draw_box
from pf_tracker_ros.world.fusion import TO_MIDDLE

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from follow_parts.chain import LibraryChain, stamp_at
from follow_parts.layout import Layout
from follow_parts.loop import Moment, moments
from follow_parts.messages import camera_info_message, odometry_message, pose_message
from follow_parts.metrics import Row, row_of
from follow_parts.rendering import CAMERA, CAMERA_HEIGHT, CAMERA_PITCH
from follow_parts.scenarios import SCENARIOS
from follow_parts.world import RATE, World
from room_map import PERSON_COLOR, POSE_COLOR, ROBOT_COLOR, RoomMap

NAME = "follower"
BAG = f"{NAME}.mcap"
WIDE, NARROW = "follower.mp4", "follower_narrow.mp4"
_SCENARIO, _SEED, _SECONDS = "depth_hand", 6, 16.0
_IMAGES, _DEPTH, _INFO = "/camera/image_raw", "/camera/depth/image", "/camera/camera_info"
_ODOMETRY, _TRUTH = "/odom", "/truth/person"
_FRAME, _FIXED_FRAME = "camera_optical_frame", "odom"
_MOUNTING = {"camera.height": CAMERA_HEIGHT, "camera.pitch": CAMERA_PITCH}
# Width of the map beside the image, pixels.
_PANEL = 500
# Row of the map's panel where the legend begins, pixels.
_LEGEND = 326
# Error that the graph below the map can show, meters.
_LARGEST = 0.5

Picture = NDArray[np.uint8]
# Red, green and blue, on white.
_INK, _QUIET, _FAINT, _DOUBT = (27, 36, 48), (110, 120, 130), (214, 220, 226), (168, 91, 0)


@dataclass(frozen=True)
class FollowerResult:
    """The robot's run.

    Attributes:
        name: Name of its folder.
        bag: Name of the file of its recording.
        view_from_above: SVG of the report, in the colors of the page.
        commands: What a command makes, to its arguments.
        errors: Distances of the published from the true positions, as a sentence.
    """

    name: str
    bag: str
    view_from_above: str
    commands: Mapping[str, list[str]]
    errors: str


def drive(folder: Path) -> list[Row]:
    """Run the robot, and write its videos and its bag.

    Args:
        folder: Of the results.

    Returns:
        What was true and what was published, frame by frame.

    Raises:
        FootageError: A file cannot be written.
    """
    scenario = SCENARIOS[_SCENARIO]
    world = World.draw(_SEED, scenario, _SECONDS)
    chain = LibraryChain(scenario, _SEED, has_imu=False)
    panel = _Panel(world.layout)
    rows: list[Row] = []
    height, width = CAMERA.height, CAMERA.width
    wide = open_encoder(folder / WIDE, RATE, (width + _PANEL, height))
    narrow = open_encoder(folder / NARROW, RATE, (width, 2 * height))
    side = (width - _PANEL) // 2
    with BagWriter(folder / BAG) as bag:
        _add_topics(bag)
        for moment in moments(world, scenario, _SEED, _SECONDS, chain):
            rows.append(row_of(moment))
            _write(bag, moment)
            image = _annotated(moment.truth.view.image, rows[-1])
            beside = panel.draw(rows, moment.truth.positions[1:])
            wide.write(np.hstack([image, beside]))
            padded = np.pad(beside, ((0, 0), (side, side), (0, 0)), constant_values=255)
            narrow.write(np.vstack([image, padded]))
    wide.close()
    narrow.close()
    return rows


def locate(folder: Path, rows: Sequence[Row]) -> FollowerResult:
    """Locate the person of the bag without ROS, for the report.

    Args:
        folder: With the bag.
        rows: Of the robot's run.

    Raises:
        DemoError: It failed.
    """
    box = rows[0].true_box
    if box is None:
        raise DemoError("the person is out of sight in the first frame")
    arguments = [str(folder / BAG), "--bag-topic", _IMAGES, "--world"]
    arguments += ["--box", ",".join(f"{value:.0f}" for value in box)]
    arguments += [f"--parameter={name}={value}" for name, value in _MOUNTING.items()]
    arguments += ["--output", str(folder / "tracked"), "--bag", "--video", "--report"]
    run_to_end("track", arguments, folder / "log" / "track.log")
    page = (folder / "tracked" / REPORT_FILE).read_text(encoding="utf-8")
    found = re.search(r"From above.*?(<svg.*?</svg>)", page, re.DOTALL)
    if found is None:
        raise DemoError(f"{folder / 'tracked' / REPORT_FILE} has no view from above")
    again = ["python", "benchmarks/follow.py", "--scenario", _SCENARIO, "--seeds", str(_SEED), "1"]
    commands = {
        "report, boxes.csv and topics.mcap": ["track", *arguments],
        "the run again, measured": [*again, "--seconds", f"{_SECONDS:g}"],
    }
    return FollowerResult(NAME, BAG, found[1], commands, errors_in_words(rows))


def errors_in_words(rows: Sequence[Row]) -> str:
    """The distances between the published and the true positions, as a sentence."""
    errors = np.array([row.error for row in rows])
    posed = np.isfinite(errors)
    if not posed.any():
        return "no position was published"
    middle, most = np.percentile(errors[posed], (50, 90))
    return (
        f"the published positions are {middle:.2f} m off the true ones in the median, "
        f"{most:.2f} m at 90 %, {TO_MIDDLE} m of it because depth shows the surface of a body, and "
        f"drawn people are flat; {100.0 * posed.mean():.0f} % of the frames have a published one"
    )


def _add_topics(bag: BagWriter) -> None:
    for topic, message_type in {
        _IMAGES: IMAGE_TYPE,
        _DEPTH: IMAGE_TYPE,
        _INFO: "sensor_msgs/msg/CameraInfo",
        _ODOMETRY: "nav_msgs/msg/Odometry",
        _TRUTH: "geometry_msgs/msg/PoseStamped",
    }.items():
        bag.add_topic(topic, message_type)


def _write(bag: BagWriter, moment: Moment) -> None:
    """Write the messages of a frame."""
    truth, new = moment.truth, bag.new
    stamp = stamp_at(truth.time)
    header, fixed = bag.header(stamp, _FRAME), bag.header(stamp, _FIXED_FRAME)
    pose, person = truth.odometry, truth.in_odometry(truth.positions[0]).tolist()
    base = pose_message(new, float(pose.x), float(pose.y), float(pose.yaw))
    messages = {
        _ODOMETRY: odometry_message(new, fixed, base),
        _INFO: camera_info_message(new, header, CAMERA),
        _DEPTH: image_message(new, header, truth.view.depth),
        _IMAGES: image_message(new, header, truth.view.image),
        _TRUTH: new("geometry_msgs/msg/PoseStamped", header=fixed, pose=pose_message(new, *person)),
    }
    for topic, message in messages.items():
        bag.write_message(topic, stamp, message)


def _annotated(image: Picture, row: Row) -> Picture:
    """The image with box and state."""
    canvas = image.copy()
    color = STATE_COLORS.get(row.state, (200, 200, 200))
    if row.box:
        draw_box(canvas, np.array(row.box), color, 2)
    text = row.state if row.state == "lost" else f"{row.state} {row.confidence:.2f}"
    for shade, width in (((0, 0, 0), 4), (color, 1)):
        cv2.putText(
            canvas, text, (10, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.7, shade, width, cv2.LINE_AA
        )
    return canvas


class _Panel:
    """Draws the room from above, with a legend and a graph of the error.

    Args:
        layout: The room.
    """

    def __init__(self, layout: Layout) -> None:
        self._map = RoomMap(layout)
        letters = findfont("DejaVu Sans")  # comes with Matplotlib
        self._font = ImageFont.truetype(letters, 15)
        self._large = ImageFont.truetype(letters, 22)

    def draw(self, rows: Sequence[Row], others: NDArray[np.float64]) -> Picture:
        """The panel at the last of all rows so far, (480, 500, 3) BGR."""
        self._map.line([one.robot.position for one in rows[-2:]], ROBOT_COLOR)
        self._map.line([one.person for one in rows[-2:]], PERSON_COLOR)
        scene = self._map.copy()
        scene.people(rows[-1], others)
        # Twice as large, then reduced: Pillow's lines have no smooth edges.
        large = Image.new("RGB", (2 * _PANEL, 2 * CAMERA.height), "white")
        self._draw_graph(ImageDraw.Draw(large), rows)
        picture = large.resize((_PANEL, CAMERA.height), Image.Resampling.LANCZOS)
        height, width = scene.image.shape[:2]
        scale = min((_PANEL - 20) / width, (_LEGEND - 10) / height)
        size = round(scale * width), round(scale * height)
        small = cv2.resize(scene.image, size, interpolation=cv2.INTER_AREA)
        picture.paste(Image.fromarray(small[..., ::-1]), ((_PANEL - size[0]) // 2, 5))
        self._write(ImageDraw.Draw(picture), rows[-1])
        return np.ascontiguousarray(np.asarray(picture)[..., ::-1])

    def _draw_graph(self, drawing: ImageDraw.ImageDraw, rows: Sequence[Row]) -> None:
        left, right, top, bottom = 2 * 66, 2 * (_PANEL - 20), 2 * 405, 2 * 462
        for share in (0.0, 0.5, 1.0):
            level = bottom - share * (bottom - top)
            drawing.line([(left, level), (right, level)], fill=_FAINT, width=2)
        points: list[tuple[float, float]] = []
        for row in rows:
            x = left + (right - left) * row.time / _SECONDS
            if math.isfinite(row.error):
                points.append((x, bottom - min(row.error / _LARGEST, 1.0) * (bottom - top)))
            else:
                drawing.rectangle((x - 2, top, x + 2, bottom), fill=(250, 226, 200))
                self._curve(drawing, points)
                points = []
        self._curve(drawing, points)

    def _curve(self, drawing: ImageDraw.ImageDraw, points: list[tuple[float, float]]) -> None:
        if len(points) > 1:
            drawing.line(points, fill=POSE_COLOR[::-1], width=4)

    def _write(self, drawing: ImageDraw.ImageDraw, row: Row) -> None:
        for index, (text, color) in enumerate(
            (("robot", ROBOT_COLOR), ("person", PERSON_COLOR), ("published position", POSE_COLOR))
        ):
            x, y = (20, 110, 210)[index], _LEGEND + 10
            drawing.ellipse((x, y + 4, x + 11, y + 15), fill=color[::-1])
            drawing.text((x + 18, y), text, fill=_INK, font=self._font)
        if math.isfinite(row.error):
            drawing.text(
                (20, 366), f"error {row.error:.2f} m", fill=POSE_COLOR[::-1], font=self._large
            )
        else:
            drawing.text((20, 366), "no position", fill=_DOUBT, font=self._large)
        drawing.text((210, 371), f"distance {row.distance:.1f} m", fill=_INK, font=self._font)
        drawing.text((20, 396), f"{_LARGEST} m", fill=_QUIET, font=self._font)
        drawing.text((20, 453), "0 m", fill=_QUIET, font=self._font)
