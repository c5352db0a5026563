"""The node on a recorded room with exact truth, in comparison with `track --world`."""

import math

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags are written with rosbags")

from diagnostic_msgs.msg import DiagnosticArray
from follow_parts.rendering import CAMERA_HEIGHT, CAMERA_PITCH
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo
from world_recording import (
    CAMERA_INFO_TOPIC,
    IMAGE_TOPIC,
    ODOMETRY_TOPIC,
    first_targets,
    write_room,
)
from world_room import Room, Walker, circling, driving

from pf_tracker_ros.footage.bags import read_topic
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.parameters import build
from pf_tracker_ros.recordings.positions import RecordedPositions
from pf_tracker_ros.recordings.recording import open_recording
from pf_tracker_ros.recordings.topics import TopicBag
from pf_tracker_ros.recordings.tracking import track_recording

FRAMES, LATENCY, RATE = 6, 0.1, math.radians(60.0)
PARAMETERS = {"camera.height": CAMERA_HEIGHT, "camera.pitch": CAMERA_PITCH}


@pytest.fixture
def recorded(tmp_path):
    """A bag of a robot that turns, what `track --world` makes of it, and the frames."""
    bag, topics = tmp_path / "room.mcap", tmp_path / "topics.mcap"
    walker = Walker(circling((3.2, 0.0), 0.4, 9.0, 0.0), (50, 60, 200), (90, 60, 40))
    frames = write_room(Room((walker,), driving(0.2, 0.25, RATE), rate=30.0), bag, FRAMES, LATENCY)
    parameters = build(LocalizerParameters, PARAMETERS)
    # The node gets the target's colors from the second frame with depth on, so without depth.
    positions = RecordedPositions(bag, IMAGE_TOPIC, {"depth": ""}, parameters)
    recording = open_recording(bag, bag_topic=IMAGE_TOPIC)
    output = TopicBag(topics, "default", 1, parameters)
    for tracked in positions.locate(track_recording(recording, first_targets(frames[0], 1))):
        output.write(tracked)
    output.close()
    return bag, topics, frames


def read(path, topic, message_type):
    return [
        (time, deserialize_message(message, message_type))
        for time, message in read_topic(path, topic)
    ]


def test_the_node_and_track_say_the_same_while_the_robot_turns(
    scene, make_localizer, given, recorded
):
    bag, topics, frames = recorded
    scene.add_sensor(Odometry, "odom")
    overrides = {name.replace(".", "__"): value for name, value in PARAMETERS.items()}
    localizer = make_localizer(**overrides)
    scene.meet(localizer)
    scene.calibrate(read(bag, CAMERA_INFO_TOPIC, CameraInfo)[0][1])
    odometry = read(bag, ODOMETRY_TOPIC, Odometry)
    sent = 0
    for time, status in read(topics, "/pf_tracker/status", DiagnosticArray):
        while sent < len(odometry) and odometry[sent][0] <= time:
            scene.send("odom", odometry[sent][1])
            sent += 1
        before = len(scene.statuses)
        scene.publish_message(status)
        scene.wait_for(lambda before=before: len(scene.statuses) > before, "status")
    expected = [message for _, message in read(topics, "/localizer/pose", PoseStamped)]
    assert len(expected) == FRAMES
    scene.wait_for(lambda: len(scene.poses) == FRAMES, "poses")
    assert scene.poses == expected
    # The direction is right although the images are late: the odometry is that of their stamps.
    for frame, pose in zip(frames, scene.poses, strict=True):
        camera, truth = np.array([frame.base.x, frame.base.y]), frame.positions[0]
        found = np.array([pose.pose.position.x, pose.pose.position.y]) - camera
        turn = math.atan2(*found[::-1]) - math.atan2(*(truth - camera)[::-1])
        assert abs(math.degrees(turn)) < 1.0
