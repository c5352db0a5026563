"""Positions of a live localizer over DDS, with boxes that follow from a scene by hand."""

import math
import sys
from array import array
from importlib import util

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from sensor_msgs.msg import CompressedImage, Image, Imu
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.node import graph_monitor
from pf_tracker_ros.node.localizer import inputs, localizer_node
from pf_tracker_ros.node.localizer.tracker_status import read_status

# A foot is seen where a target begins; its center, which is told, is behind that.
FOOT_TO_CENTER = 0.1


@pytest.fixture
def listened(scene):
    """The messages of the topics beside pose and status, by name."""
    types = {
        "pose_with_covariance": PoseWithCovarianceStamped,
        "odometry": Odometry,
        "bearing": Vector3Stamped,
        "markers": MarkerArray,
    }
    received = {name: [] for name in types}
    for name, message_type in types.items():
        scene.listen(message_type, f"localizer/{name}", received[name].append)
    return received


def position(message):
    point = message.pose.position
    return [point.x, point.y]


def walk(index):
    """A target that walks to the left at 1 m/s, 6 m before the camera."""
    return 6.0, -0.5 + 0.04 * index


def test_a_walker_before_a_still_camera(scene, start, listened, given):
    start(method="ground")
    statuses = scene.show_all(given, 50, walk)
    stamp = given.start + 49 * given.frame
    last = scene.wait_for(lambda: [p for p in scene.poses if given.stamp_of(p) == stamp], "pose")[0]
    assert last.header.frame_id == "odom"
    assert position(last) == pytest.approx(walk(49), abs=FOOT_TO_CENTER)
    # It walks along the y axis.
    turn = last.pose.orientation
    assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(math.pi / 2, abs=0.2)
    assert statuses[-1].values["pose"] == "published"
    assert statuses[-1].values["camera_mounting"] == "parameters"
    assert statuses[-1].targets[1]["method"] == "ground"
    assert float(statuses[-1].targets[1]["velocity_y"]) == pytest.approx(1.0, abs=0.15)

    for name in ("odometry", "bearing", "markers"):
        scene.wait_for(lambda name=name: len(listened[name]) == 50, name)
    odometry = listened["odometry"][-1]
    # In the frame of the target, whose x axis is its heading.
    assert odometry.child_frame_id == "target"
    assert odometry.twist.twist.linear.x == pytest.approx(1.0, abs=0.15)
    assert odometry.twist.twist.linear.y == pytest.approx(0.0, abs=1e-6)
    covariance = np.reshape(odometry.pose.covariance, (6, 6))
    assert np.allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0.0

    bearing = listened["bearing"][-1]
    assert bearing.header.frame_id == given.optical
    # Left in the fixed frame is -x in the optical frame, and the middle of the target is above
    # its foot by half of its height.
    direction = np.array([-walk(49)[1], 1.5 - 1.75 / 2, 6.0])
    direction /= np.linalg.norm(direction)
    found = [bearing.vector.x, bearing.vector.y, bearing.vector.z]
    assert found == pytest.approx(direction, abs=1e-6)

    cleared, *markers = listened["markers"][-1].markers
    assert cleared.action == Marker.DELETEALL
    assert [(m.ns, m.id) for m in markers] == [("regions", 1), ("velocities", 1), ("labels", 1)]


# The change of a target, the reason, and whether its bearing is still told.
DOUBTS = [
    ({"state": "occluded"}, "target 1 is occluded", False),
    ({"confidence": 0.3}, "the confidence of target 1 is 0.30, below min_confidence (0.7)", True),
]


@pytest.mark.parametrize("doubt", DOUBTS)
def test_it_is_silent_about_a_target_that_is_not_trusted(scene, start, listened, given, doubt):
    change, reason, has_bearing = doubt
    start()
    scene.show_all(given, 10, walk)
    for index in range(10, 15):
        target = given.target(box=given.box_at(*walk(index)), **change)
        status = scene.show(given.start + index * given.frame, [target])
    assert status.values["pose"] == "silent"
    assert status.values["reason"] == reason
    seconds, nanoseconds = divmod(given.start + 10 * given.frame, 10**9)
    assert status.values["silent_since"] == f"{seconds}.{nanoseconds:09d}"
    assert status.message.startswith("no pose for 0.2 s: ")
    assert "method" not in status.targets[1]
    # It is back where it was expected.
    again = scene.show_all(given, 1, walk, start=15)[0]
    assert again.values["pose"] == "published"
    # The markers still show where it is assumed to be.
    scene.wait_for(lambda: len(listened["markers"]) == 16, "markers")
    seen = 16 if has_bearing else 11
    scene.wait_for(lambda: len(listened["bearing"]) >= seen, "bearings")
    assert (len(scene.poses), len(listened["bearing"])) == (11, seen)
    assert len(listened["markers"][12].markers) == 4


def test_it_is_silent_without_a_selected_target(scene, start, given):
    start()
    one = [given.target()]
    for index, targets, values, reason in (
        (0, [], {"selected": 0, "state": "idle"}, "the tracker has no target"),
        (1, one, {"selected": 0}, "no target is selected; select one on the tracker's topic "),
        (2, one, {"selected": 7}, "target 7 is not in the tracker's status"),
        (3, [], {"state": "skipped"}, "the tracker skipped the image"),
        (1, one, {}, "the image is not newer than the last one"),
    ):
        status = scene.show(given.start + index * given.frame, targets, **values)
        assert status.values["reason"].startswith(reason)
    assert scene.poses == []


def test_a_moving_robot_is_taken_at_the_stamp_of_the_image(scene, start, given, monkeypatch):
    """It drives along x at 2 m/s and turns; images are between the poses."""
    # Odometry is waited for also where this machine is slow.
    monkeypatch.setattr(inputs, "_SILENT_AFTER", 60.0)
    start((Odometry, "odom"), method="ground")

    def pose_at(seconds):
        return 2.0 * seconds, 0.0, 0.5 * seconds

    target = np.array([15.0, 1.0])
    stamp = given.start
    for index in range(30):
        stamp = given.start + index * given.frame
        seconds = index * 0.04
        x, y, yaw = pose_at(seconds)
        rotation = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        forward, left = rotation.T @ (target - [x, y])
        for later in (-0.013, 0.017):
            message = given.odometry(stamp + int(later * 1e9), *pose_at(seconds + later))
            scene.send("odom", message)
        status = scene.show(stamp, [given.target(box=given.box_at(forward, left))])
        assert status.values["camera_motion"] == "odometry"
    last = scene.wait_for(lambda: [p for p in scene.poses if given.stamp_of(p) == stamp], "pose")[0]
    assert position(last) == pytest.approx(target, abs=0.1)
    assert abs(float(status.targets[1]["velocity_x"])) < 0.3

    # Without a pose after the image, the last one does not stand for it.
    late = scene.show(stamp + 2 * given.frame, [given.target(box=given.box_at(12.0, 0.0))])
    assert late.values["pose"] == "silent"
    assert "odometry ends 0.063 s before the image" in late.values["reason"]
    assert float(late.values["waited_ms"]) >= 150.0
    scene.send("odom", given.odometry(stamp + 3 * given.frame, frame="map"))
    other = scene.show(stamp + 3 * given.frame, [given.target(box=given.box_at(12.0, 0.0))])
    assert "odometry is in the frame 'map', but fixed_frame is 'odom'" in other.values["reason"]


def test_depth_of_the_image_is_used_and_other_depth_is_not(scene, start, given):
    """The depth says 5.5 m while the box says 6 m: only what is of the image's time counts."""
    start((Image, "depth"), coast=0.5, method="depth")
    depth = np.full((given.height, given.width), 9.0)
    box = given.box_at(6.0, 0.0)
    x, y, width, height = (int(value) for value in box)
    depth[y : y + height, x : x + width] = 5.5
    depth[::3] = 0.0
    depth[1::7], depth[2::7] = np.nan, np.inf
    scene.send("depth", given.depth(given.start + 20_000_000, depth.astype(np.float32)))
    near = scene.show(given.start, [given.target(box=box)])
    assert near.targets[1]["method"] == "depth"
    assert float(near.values["depth_offset"]) == pytest.approx(0.02)
    assert position(scene.poses[0]) == pytest.approx([5.5, 0.0], abs=0.2)

    far = scene.show(given.start + 2 * given.frame, [given.target(box=box)])
    assert far.values["pose"] == "predicted", "the last position is recent"
    assert far.targets[1]["reason"] == "the box of target 1 gives no range"
    assert "the nearest depth image is 0.060 s before the image" in far.message
    assert "depth_offset" not in far.values


def test_depth_that_is_compressed_is_used(scene, start, given):
    start(
        (CompressedImage, "depth/compressedDepth"),
        method="depth",
        depth_transport="compressedDepth",
    )
    png = cv2.imencode(".png", np.full((48, 64), 5500, np.uint16))[1].tobytes()
    message = CompressedImage(format="16UC1; compressedDepth png", data=array("B", bytes(12) + png))
    message.header = given.odometry(given.start).header
    scene.send("depth/compressedDepth", message)
    status = scene.show(given.start, [given.target(box=given.box_at(6.0, 0.0))])
    assert status.targets[1]["method"] == "depth"
    assert float(status.targets[1]["x"]) == pytest.approx(5.5, abs=0.2)


def test_of_two_depths_in_a_box_that_of_the_targets_colors_counts(scene, start, given):
    """A column of the target 6 m away, in a box that shows a wall at 9 m for the most part."""
    localizer = start((Image, "depth"), (Image, "pf_tracker/target_probability"), method="depth")
    box = given.box_at(6.0, 0.0)
    depth = np.full((given.height, given.width), 9.0, np.float32)
    middle, half = int(box[0] + box[2] / 2), int(0.2 * box[2])
    depth[:, middle - half : middle + half] = 6.0
    probability = np.full((48, 20), 12, np.uint8)
    probability[:, 6:14] = 243
    # The first depth makes it subscribe to the colors.
    scene.send("depth", given.depth(given.start, depth))
    scene.show(given.start, [given.target(box=box, state="occluded")])
    scene.meet(localizer)
    for index in range(1, 4):
        stamp = given.start + index * given.frame
        scene.send("depth", given.depth(stamp, depth))
        scene.send("pf_tracker/target_probability", given.gray(stamp, probability))
        status = scene.show(stamp, [given.target(id=index, box=box)], selected=index)
        assert float(status.targets[index]["x"]) == pytest.approx(6.0, abs=0.3)


def test_gravity_gives_the_tilt_of_the_camera(scene, start, given):
    """The camera looks down by 0.2 rad; the foot of the box at the principal point."""
    start((Imu, "imu"), method="ground")
    pitch = 0.2
    up = (0.0, -math.cos(pitch), -math.sin(pitch))
    scene.send("imu", given.imu(given.start, up))
    target = given.target(box=(310.0, 140.0, 20.0, 100.0))
    status = scene.show(given.start, [target])
    assert status.values["camera_mounting"] == "imu"
    assert float(status.values["camera_pitch"]) == pytest.approx(pitch, abs=1e-6)
    # The optical axis meets the ground at height / tan(pitch).
    assert float(status.targets[1]["x"]) == pytest.approx(1.5 / math.tan(pitch), abs=FOOT_TO_CENTER)
    late = scene.show(given.start + 100 * 10**9, [target])
    assert "last measured 100.000 s before the image" in late.values["reason"]
    assert scene.show(given.start + 2 * 10**9, [target]).values["camera_mounting"] == "imu"
    later = given.start + 2 * 10**9 + given.frame
    scene.send("imu", given.imu(later, up, frame="base_link"))
    other = scene.show(later, [target])
    if util.find_spec("tf2_ros") is None:
        assert "gravity is in the frame 'base_link'" in other.values["reason"]


def test_what_is_wrong_with_the_calibration_is_told_and_it_goes_on(scene, start, given):
    start(calibrated=False)
    target = given.target(box=given.box_at(6.0, 0.0))

    def reason(index, info=None):
        if info:
            scene.calibrate(info)
        return scene.show(given.start + index * given.frame, [target]).values.get("reason", "")

    assert "no CameraInfo on /camera_info" in reason(0)
    assert "the focal lengths are 0 and 0 px" in reason(1, given.camera_info(focal=0.0))
    assert "not finite" in reason(2, given.camera_info(focal=math.nan))
    assert "calibration is for images of 320 x 240" in reason(3, given.camera_info(320, 240))
    assert reason(4, given.camera_info()) == ""


def test_a_frame_waits_for_the_first_calibration(scene, start, given, monkeypatch):
    monkeypatch.setattr(localizer_node, "_MAX_WAIT", 60.0)
    localizer = start(calibrated=False)
    scene.publish(given.start, [given.target(box=given.box_at(6.0, 0.0))])
    scene.wait_for(lambda: localizer._waiting, "waiting frame")
    scene.calibrate()
    (status,) = scene.wait_for(lambda: scene.statuses, "status")
    assert status.values["pose"] == "published"


def test_the_calibration_of_another_camera_is_told_of(scene, start, given):
    start(calibrated=False)
    target = given.target(box=given.box_at(6.0, 0.0))
    for index, (frame_id, is_other) in enumerate(
        [("", False), ("rear_camera", True), (given.optical, False), (f"/{given.optical}", False)]
    ):
        info = given.camera_info()
        info.header.frame_id = frame_id
        scene.calibrate(info)
        status = scene.show(given.start + index * given.frame, [target])
        assert status.values["pose"] == "published"
        assert ("/camera_info is of the frame 'rear_camera'" in status.message) == is_other
        assert (status.level == DiagnosticStatus.WARN) == is_other


def test_time_that_goes_back_starts_anew(scene, start, given):
    localizer = start()
    scene.show_all(given, 10, walk)
    scene.show(given.start + 3600 * 10**9, [given.target(box=given.box_at(9.0, 1.0))])
    first = scene.show_all(given, 1, lambda index: (12.0, 3.0))[0]
    assert first.values["pose"] == "published"
    assert float(first.targets[1]["x"]) == pytest.approx(12.0, abs=0.5)
    assert localizer._frames.time_jumps == 1


def test_several_targets_have_their_ids(scene, start, listened, given):
    start(method="ground")
    places = {3: (5.0, 1.0), 8: (8.0, -2.0)}
    for index in range(3):
        targets = [given.target(id=id, box=given.box_at(*one)) for id, one in places.items()]
        status = scene.show(given.start + index * given.frame, targets, selected=8)
    found = {id: (float(one["x"]), float(one["y"])) for id, one in status.targets.items()}
    assert found == {id: pytest.approx(one, abs=FOOT_TO_CENTER) for id, one in places.items()}
    scene.wait_for(lambda: len(scene.poses) == 3, "poses")
    assert position(scene.poses[-1]) == pytest.approx(places[8], abs=FOOT_TO_CENTER)
    scene.wait_for(lambda: len(listened["markers"]) == 3, "markers")
    labels = [m.text for m in listened["markers"][-1].markers if m.ns == "labels"]
    assert labels == ["3 person", "8 person"]


def test_detections_in_three_dimensions(scene, start, given):
    messages = pytest.importorskip("vision_msgs.msg")
    received = []
    scene.listen(messages.Detection3DArray, "localizer/detections_3d", received.append)
    start(method="ground")
    scene.show_all(given, 3, lambda index: (6.0, 0.0))
    scene.wait_for(lambda: len(received) == 3, "detections")
    (detection,) = received[-1].detections
    assert (detection.id, detection.results[0].hypothesis.class_id) == ("1", "person")
    assert detection.bbox.size.z == pytest.approx(1.75, abs=0.02)
    assert detection.bbox.size.x == pytest.approx(0.5, abs=0.02)
    assert detection.bbox.center.position.z == pytest.approx(detection.bbox.size.z / 2)


def test_parameters_apply_at_run_time_and_wrong_ones_are_refused(scene, start, given):
    localizer = start(method="height")
    target = given.target(box=given.box_at(6.0, 0.0))
    assert scene.show(given.start, [target]).targets[1]["method"] == "height"
    for name, value in (("camera.height", math.nan), ("fixed_frame", "")):
        (refused,) = localizer.set_parameters([Parameter(name, value=value)])
        assert not refused.successful
        assert f"parameter '{name}' is {value!r}; allowed" in refused.reason
    (accepted,) = localizer.set_parameters([Parameter("method", value="ground")])
    assert accepted.successful
    assert scene.show(given.start + given.frame, [target]).targets[1]["method"] == "ground"


def test_with_an_invalid_parameter_it_says_why_there_is_no_position(scene, make_localizer, given):
    localizer = make_localizer(camera__height=-1.0)
    scene.listen_to_health()
    scene.meet(localizer)
    scene.calibrate()
    status = scene.show(given.start, [given.target(box=given.box_at(6.0, 0.0))])
    assert "parameter 'camera.height' is -1.0; allowed: float, 0 to 1000" in status.values["reason"]
    scene.wait_for(
        lambda: [one for one in scene.health if one.level == DiagnosticStatus.ERROR], "error"
    )


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("box_x", None, "it has no key 'box_x'"),
        ("box_width", "inf", "box_width is 'inf'; expected a finite number"),
        ("covariance_xx", "a", "covariance_xx is 'a'; expected a finite number"),
        ("id", "1.5", "id is '1.5'; expected a whole number"),
        ("id", "9" * 300, f"id is '{'9' * 199}...; expected a whole number from 0 to 2147483647"),
        ("id", "-1", "id is '-1'; expected a whole number"),
        ("confidence", "2", "confidence is 2; expected 0 to 1"),
        ("confidence", "-0.5", "confidence is -0.5; expected 0 to 1"),
        ("state", "resting", "state is 'resting'; expected tracking, occluded, lost"),
        ("box_height", "0", "its box is 1 x 0 px; expected positive sides"),
        ("covariance_hh", "-1", "its covariance has a negative variance; expected 0 or more"),
    ],
)
def test_a_target_that_cannot_be_read_does_not_cost_the_others(given, key, value, reason):
    broken = given.target(id=1) | {key: value}
    if value is None:
        del broken[key]
    frame, problem = read_status(given.status(given.start, [broken, given.target(id=2)]))
    assert [target.id for target in frame.targets] == [2]
    assert problem.startswith(f"'target {broken['id']}' is left out: {reason}")


def test_of_many_targets_the_selected_and_the_most_confident_are_located(given):
    """A tracker with an error would otherwise take the time of all other frames."""
    targets = [given.target(id=id, confidence=id / 1001) for id in range(1, 1002)]
    frame, problem = read_status(given.status(given.start, targets, selected=3))
    assert [target.id for target in frame.targets] == [3, *range(903, 1002)]
    assert problem.startswith("it has 1001 targets; 100 of them are located, the selected one")
    with pytest.raises(ValueError, match="it has 2001 targets; expected at most 2000"):
        read_status(given.status(given.start, targets[:1] * 2001))


def test_messages_that_are_no_status_of_a_tracker_are_told_of(scene, start, given, capfd):
    start()
    scene.publish_message(DiagnosticArray())
    scene.publish(given.start, [], selected="first")
    scene.publish(given.start, [], image_width="wide")
    scene.publish(0, [given.target()])
    wrong = given.target(id=2, confidence="high")
    sound = given.target(box=given.box_at(6.0, 0.0))
    status = scene.show(given.start + given.frame, [wrong, sound])
    assert status.values["pose"] == "published"
    assert "the status on /pf_tracker/status: 'target 2' is left out" in status.message
    assert list(status.targets) == [1]
    assert scene.statuses == [status]
    told = capfd.readouterr().err
    for reason in ("it is empty", "selected is 'first'", "image_width is 'wide'", "its images"):
        assert f"the status on /pf_tracker/status refused: {reason}" in told


def test_it_works_only_while_it_is_active(scene, make_localizer, services_of, given):
    localizer = make_localizer(camera__height=1.5, autostart=False)
    services = services_of(scene, "localizer", scene.wait_for)

    def change(*transitions):
        for id in transitions:
            future = services.ask(ChangeState, "change_state", transition=Transition(id=id))
            scene.wait_for(future.done, "transition")
            assert future.result().success

    scene.listen_to_health()
    target = given.target(box=given.box_at(6.0, 0.0))
    assert localizer.lifecycle_state == "unconfigured"
    for index in range(2):
        change(Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
        scene.meet(localizer)
        scene.calibrate()
        status = scene.show(given.start + index * given.frame, [target])
        assert status.values["pose"] == "published"
        change(Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
    assert [s for s in localizer.subscriptions if "pf_tracker" in s.topic_name] == []
    before = len(scene.health)
    scene.wait_for(lambda: len(scene.health) > before, "diagnostics")
    health = scene.health[-1]
    assert health.name == "localizer: localizer"
    assert health.message == "unconfigured, not locating"


def test_a_tf2_ros_that_cannot_be_loaded_is_told_in_a_sentence(
    make_localizer, tmp_path, monkeypatch, capfd
):
    (tmp_path / "tf2_ros.py").write_text("raise OSError('libtf2.so: no such file')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "tf2_ros", raising=False)
    localizer = make_localizer()
    values = localizer._health()[2]
    assert (values["lifecycle"], values["tf2"]) == ("active", "cannot be loaded")
    text = capfd.readouterr().err
    assert "tf2_ros cannot be loaded: libtf2.so: no such file; reinstall" in text
    assert "Traceback" not in text


def test_its_health_names_the_tracker_that_is_missing(scene, start):
    start(calibrated=False)
    scene.listen_to_health()
    missing = "no status of the tracker on /pf_tracker/status"
    scene.wait_for(lambda: [h for h in scene.health if h.message == missing], "warning")
    rates = {"camera_info_rate", "depth_rate", "odom_rate", "imu_rate"}
    assert rates <= scene.health[-1].values.keys()


@pytest.mark.usefixtures("fast_reports")
def test_a_second_tracker_on_the_status_is_named(scene, make_localizer, graph, monkeypatch):
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.02)
    make_localizer()
    scene.listen_to_health()
    other = graph.client(namespace="/left")
    second = other.create_publisher(DiagnosticArray, "/pf_tracker/status", 10)
    fault = (
        "/pf_tracker/status has 2 publishers, '/left/client' and '/scene'; end all but one, or "
        "remap them to topics of their own"
    )
    scene.wait_for(lambda: any(fault in h.message for h in scene.health), "report")
    other.destroy_publisher(second)
    scene.wait_for(lambda: fault not in scene.health[-1].message, "its end")
