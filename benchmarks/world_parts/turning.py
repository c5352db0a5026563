"""Directions from a robot that turns."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np
from tables import Table
from world_recording import FRAME, IMAGE_TOPIC, stamp_at, write_room
from world_room import CAMERA_HEIGHT, CAMERA_PITCH, Room, RoomFrame, Walker, circling, driving

from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.recordings.positions import RecordedPositions, RecordedSensors
from pf_tracker_ros.stamps import NANOSECONDS

# Frames, and angular velocity in degrees per second.
FRAMES, RATE = 100, 60.0


def turning_table(on_progress: OnProgress, frames: int = FRAMES, rate: float = RATE) -> Table:
    """Directions in the fixed frame while the robot turns and the images arrive late.

    The boxes are exact. The positions are those of `track --world`, by the localizer's own code,
    with odometry at the image's stamp.
    """
    base = driving(0.2, 0.3, np.radians(rate))
    walker = Walker(circling((5.0, 0.0), 0.6, 9.0, 0.0), (50, 60, 200), (90, 60, 40))
    rows = []
    for latency in (0.0, 0.1):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / "room.mcap"
            rendered = write_room(Room((walker,), base, rate=20.0), bag, frames, latency)
            parameters = build(
                LocalizerParameters, {"camera.height": CAMERA_HEIGHT, "camera.pitch": CAMERA_PITCH}
            )
            positions = RecordedPositions(bag, IMAGE_TOPIC, {}, parameters)
            with closing(positions.open()) as sensors:
                errors = [direction_error(frame, sensors, latency) for frame in rendered]
        on_progress("turning", frames)
        found = [error for error in errors if error is not None]
        median, ninety = np.percentile(found, (50, 90))
        rows.append(
            [
                f"{latency:g} s",
                str(len(found)),
                *(f"{one:.2f}" for one in (median, ninety, max(found))),
            ]
        )
    return Table(
        f"Turning at {rate:g} degrees a second, exact boxes",
        ["images late by", "frames", "median, degrees", "90 %", "largest"],
        [rows],
    )


def direction_error(frame: RoomFrame, sensors: RecordedSensors, latency: float) -> float | None:
    """Error of the first walker's filtered direction from the camera, degrees; None without."""
    box = frame.boxes[0]
    if box is None:
        return None
    stamp = stamp_at(frame.time)
    target = ReportedTarget(1, "", "tracking", 1.0, box, np.eye(4))
    size = frame.image.shape[1], frame.image.shape[0]
    located = sensors.locate(
        TrackerFrame(stamp, FRAME, False, "tracking", 1, size, (target,)),
        stamp + round(latency * NANOSECONDS),
    )
    world = located.targets[0].world if located.targets else None
    if world is None:
        return None
    camera = np.array([frame.base.x, frame.base.y])
    directions = [one - camera for one in (world.filtered.position, frame.positions[0])]
    (x, y), (true_x, true_y) = directions
    return abs(float(np.degrees(np.arctan2(x * true_y - y * true_x, x * true_x + y * true_y))))
