"""`track --world`: positions in meters of the targets of a bag with exact truth."""

import math

import numpy as np
import pytest
from common import read_boxes

pytest.importorskip("rosbags", reason="bags are written with rosbags")
pytest.importorskip("matplotlib", reason="the report needs it")

from follow_parts.robot import Pose2D
from rosbags.highlevel import AnyReader
from world_recording import DEPTH_TOPIC, IMAGE_TOPIC, first_targets, stamp_at, write_room
from world_room import Room, Walker, circling, driving, standing

from pf_tracker_ros.evaluation.reports import timeline
from pf_tracker_ros.footage.bag_writing import BagWriter
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.recordings.positions import RecordedPositions
from pf_tracker_ros.recordings.recording import open_recording
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import file_text
from pf_tracker_ros.recordings.tracking import track_recording

MOUNTING = ("--parameter", "camera.height=0.8", "--parameter", "camera.pitch=0.03")
FRAMES = 12
# Squared distance of the 99 % region of two dimensions.
REGION_99 = -2.0 * math.log(0.01)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A bag of two people before a robot that turns, and its frames."""
    folder = tmp_path_factory.mktemp("room")
    walkers = (
        Walker(circling((4.5, 0.5), 0.8, 9.0, 1.0), (50, 60, 200), (90, 60, 40)),
        Walker(circling((5.5, -1.0), 0.6, 9.0, 3.0), (170, 140, 60), (60, 60, 60), 1.7),
    )
    bag = folder / "room.mcap"
    frames = write_room(Room(walkers, driving(0.2, 0.1, 0.3), rate=12.0), bag, FRAMES, 0.05)
    targets = first_targets(frames[0], 2)
    target_file(bag).write_text(file_text(targets, bag), encoding="utf-8")
    return bag, frames


@pytest.fixture
def locate(track, room, tmp_path):
    """Tracks and locates, with further arguments; returns the rows of boxes.csv."""

    def run(*arguments, mounting=MOUNTING):
        output = tmp_path / "out"
        given = (room[0], "--bag-topic", IMAGE_TOPIC, "--world", *mounting, "--output", output)
        code, _, err = track(*given, *arguments)
        assert code == 0, err
        return read_boxes(output), err

    return run


def errors_of(rows, frames):
    """Distance to the truth over the range, and squared distance in standard deviations."""
    relative, squared = [], []
    for row in rows:
        if not row["position_x"]:
            continue
        frame = frames[int(row["frame"])]
        truth = frame.positions[int(row["id"]) - 1]
        error = np.array([float(row["position_x"]), float(row["position_y"])]) - truth
        xx, xy, yy = (float(row[f"covariance_{name}"]) for name in ("xx", "xy", "yy"))
        squared.append(error @ np.linalg.solve([[xx, xy], [xy, yy]], error))
        away = np.hypot(*(truth - (frame.base.x, frame.base.y)))
        relative.append(np.linalg.norm(error) / away)
    return np.array(relative), np.array(squared)


def test_positions_velocities_and_regions_are_true(locate, room):
    rows, err = locate()
    assert err == ""
    assert len(rows) == 2 * FRAMES
    relative, squared = errors_of(rows, room[1])
    assert len(relative) == len(rows)
    assert np.median(relative) < 0.03
    assert (squared < REGION_99).mean() > 0.9
    assert {row["method"] for row in rows} == {"ground+height+depth"}
    # The true speed is the circle's length over its period.
    speeds = [math.hypot(float(row["velocity_x"]), float(row["velocity_y"])) for row in rows[-2:]]
    assert speeds == pytest.approx([2 * math.pi * 0.8 / 9, 2 * math.pi * 0.6 / 9], abs=0.25)


@pytest.mark.parametrize(
    ("arguments", "method", "limit"),
    [
        (["--world-topic", "depth=", *MOUNTING], "ground+height", 0.08),
        # Transforms of the bag stand for the camera's height and angles, and for the odometry.
        (["--world-topic", "odom="], "ground+height+depth", 0.03),
    ],
)
def test_without_a_sensor_the_others_remain(locate, room, arguments, method, limit):
    rows, err = locate(*arguments, mounting=())
    assert err == ""
    assert {row["method"] for row in rows} == {method}
    relative, squared = errors_of(rows, room[1])
    assert len(relative) == len(rows)
    assert np.median(relative) < limit
    assert (squared < REGION_99).mean() > 0.9


def test_gravity_stands_for_the_angles_and_a_file_for_the_command_line(locate, room, tmp_path):
    file = tmp_path / "parameters.yaml"
    file.write_text(
        "localizer:\n  ros__parameters:\n    camera: {height: 0.8}\n    method: ground\n"
    )
    rows, _ = locate("--params-file", file, mounting=())
    assert {row["method"] for row in rows} == {"ground"}
    assert np.median(errors_of(rows, room[1])[0]) < 0.1


def test_the_bag_has_the_localizers_topics_and_the_report_a_view_from_above(
    locate, room, tmp_path, monkeypatch
):
    asked = []
    monkeypatch.setattr(
        timeline, "losses", lambda *_, has_depth: asked.append(has_depth) or ([], 0)
    )
    rows, _ = locate("--bag", "--report")
    # Depth may be the cause that a target counts as hidden.
    assert asked == [True]
    with AnyReader([tmp_path / "out" / "topics.mcap"]) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
        markers = [
            (log_time, reader.deserialize(data, connection.msgtype).markers)
            for connection, log_time, data in reader.messages()
            if connection.topic == "/localizer/markers"
        ]
    assert counts["/localizer/status"] == counts["/localizer/markers"] == FRAMES
    log_time, last = markers[-1]
    assert log_time == stamp_at(room[1][-1].time + 0.05)
    regions = {one.id: one.pose.position for one in last if one.ns == "regions"}
    for row in rows[-2:]:
        place = regions[int(row["id"])]
        assert (place.x, place.y) == (float(row["position_x"]), float(row["position_y"]))
    assert last[1].header.frame_id == "odom"
    page = (tmp_path / "out" / "report.html").read_text()
    view = page[page.index("From above") :]
    view = view[: view.index("</svg>")]
    for text in ("target 1 walker 1", "target 2 walker 2", "x in odom, m", "camera"):
        assert text in view
    # Colors of the page.
    assert "#010101" not in view


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--parameter", "camera.height=0.8"), "is for the localizer; add --world"),
        (("--world-topic", "depth="), "add --world"),
        (("--world", "--world-topic", "lidar=/scan"), "camera_info, depth, odom, imu"),
        (("--world", "--world-topic", "depth=/scan"), f"there are: {DEPTH_TOPIC}"),
        (("--world", "--parameter", "camera.height=-1"), "camera.height"),
        (("--world", "--parameter", "camera.tilt=1"), "no parameter 'camera.tilt'"),
    ],
)
def test_a_wrong_request_is_refused(refusal, room, arguments, reason):
    assert reason in refusal(room[0], "--bag-topic", IMAGE_TOPIC, *arguments)


def test_no_calibration_or_several_depths_are_refused(
    refusal, room, moving_square_sequence, tmp_path
):
    bags = {"images.mcap": ["/image"], "cameras.mcap": ["/camera/color/image_raw"]}
    depths = ["/camera/aligned_depth/image", "/camera/depth/image"]
    bags["cameras.mcap"] += depths
    for name, topics in bags.items():
        with BagWriter(tmp_path / name) as writer:
            for topic in topics:
                writer.add_topic(topic, "sensor_msgs/msg/Image")
                writer.write_image(topic, stamp_at(0.0), room[1][0].image)
            for camera in ("color", "depth") if len(topics) > 1 else ():
                writer.add_topic(f"/camera/{camera}/camera_info", "sensor_msgs/msg/CameraInfo")
    several = f"several topics for depth: {', '.join(depths)}; choose with --world-topic"
    for arguments, reason in (
        ((tmp_path / "images.mcap",), "CameraInfo"),
        ((moving_square_sequence,), "CameraInfo"),
        ((tmp_path / "cameras.mcap", "--bag-topic", "/camera/color/image_raw"), several),
    ):
        assert reason in refusal(*arguments, "--world", "--box", "1,1,9,9")


def test_useless_sensors_are_told_once_and_tracking_goes_on(track, room, tmp_path):
    bag = tmp_path / "zeros.mcap"
    with BagWriter(bag) as writer:
        writer.add_topic("/image", "sensor_msgs/msg/Image")
        writer.add_topic("/camera_info", "sensor_msgs/msg/CameraInfo")
        for frame in room[1][:4]:
            stamp = stamp_at(frame.time)
            writer.write_image("/image", stamp, frame.image)
            zeros = {"k": np.zeros(9), "r": np.zeros(9), "p": np.zeros(12)}
            info = writer.new("sensor_msgs/msg/CameraInfo", header=writer.header(stamp), **zeros)
            writer.write_message("/camera_info", stamp, info)
    box = ",".join(map(str, room[1][0].boxes[0]))
    unreached = (room[0], "--bag-topic", IMAGE_TOPIC, "--world-topic", "tf_static=")
    for name, arguments, reason in (
        ("zeros", (bag, "--box", box), "the CameraInfo on /camera_info is not usable"),
        ("tf", unreached, "no transform from camera_optical_frame to odom; record it"),
    ):
        code, out, err = track(*arguments, "--world", "--output", tmp_path / name)
        assert (code, err.count(reason)) == (0, 1), err
        assert "positions, also of hidden targets, in 0%" in out


def test_the_tracker_gets_what_covers_its_target_in_the_frame_before(tmp_path, monkeypatch):
    """Somebody at 3 m walks past the target at 5 m: its confidence falls a frame later."""
    walkers = (
        Walker(standing(5.0, 0.0), (50, 60, 200), (90, 60, 40)),
        Walker(lambda time: (3.0, 1.05 - 1.5 * time), (170, 140, 60), (60, 60, 60), 1.8),
    )
    bag = tmp_path / "room.mcap"
    frames = write_room(Room(walkers, lambda time: Pose2D(0.0, 0.0, 0.0), rate=10.0), bag, 9)
    parameters = build(LocalizerParameters, {"camera.height": 0.8, "camera.pitch": 0.03})
    positions = RecordedPositions(bag, IMAGE_TOPIC, {}, parameters)
    recording = open_recording(bag, bag_topic=IMAGE_TOPIC)
    targets = first_targets(frames[0], 1)
    located = list(positions.locate(track_recording(recording, targets)))
    hints = LocatedFrame.hints.fget

    def unknown(frame):
        return {id: hint._replace(covered_share=None) for id, hint in hints(frame).items()}

    monkeypatch.setattr(LocatedFrame, "hints", property(unknown))
    untold = list(positions.locate(track_recording(recording, targets)))
    monkeypatch.undo()
    shares = np.array([frame.located.hints[1].covered_share for frame in located])
    hidden = np.array([1.0 - frame.visible[0] for frame in frames])
    # The share is that of boxes, which bodies do not fill.
    assert shares == pytest.approx(hidden, abs=0.12)
    lowered = [
        one.targets[0].estimate.confidence < other.targets[0].estimate.confidence
        for one, other in zip(located, untold, strict=True)
    ]
    first = int(np.argmax(shares > 0.25)) + 1
    assert lowered[first]
    assert not any(lowered[:first])
