"""The launch files, run by the real `ros2`; test_launch_arguments.py has their arguments."""

import pytest

TRACKER = "ros2 launch pf_tracker_ros tracker.launch.py"
REPLAY = "ros2 launch pf_tracker_ros replay.launch.py"
DETECTOR = "ros2 launch pf_tracker_ros detector.launch.py"
FOLLOW = "ros2 launch pf_tracker_ros follow.launch.py"
RUN_REPLAY = "ros2 run pf_tracker_ros replay"
TARGET = 'target_box:="[42, 188, 44, 132]"'


def test_a_replay_is_tracked_and_ends_with_its_recording(shell, drive):
    with shell.started(f"{REPLAY} source:={drive} {TARGET} rate:=2.0 seed:=3") as launch:
        assert launch.wait(60.0) == 0
    for told in (
        "preset default; images on /image",
        "target 1 started on the box (42, 188, 44, 132)",
        "published 100 frames of drive (/camera/image_raw)",
        "was required: shutting down",
    ):
        assert told in launch.output


def test_every_flag_is_taken_as_python_and_yaml_write_it(shell, heard, drive):
    from geometry_msgs.msg import PolygonStamped

    flags = "lockstep:=True publish_clock:=TRUE large_images:=False start_paused:=false loop:=1"
    command = f"{REPLAY} source:={drive} {TARGET} {flags} namespace:=left preset:=li2007"
    with shell.started(f"{command} image:=/camera/image_raw log_level:=debug") as launch:
        box = heard(PolygonStamped, "/left/pf_tracker/box")
        assert 1 <= box.header.stamp.sec <= 5
        assert launch.end() == 0
    assert "[DEBUG]" in launch.output


def test_a_replay_alone_starts_no_tracker(shell, drive):
    with shell.started(f"{REPLAY} source:={drive} tracker:=false rate:=100.0") as launch:
        assert launch.wait(60.0) == 0
    assert "pf_tracker" not in launch.output


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("source:=none.mcap", "not playing: there is no none.mcap"),
        ("source:=drive.mcap bag_topic:=/nose", "has no image topic /nose"),
    ],
)
def test_a_recording_that_cannot_be_played_ends_the_launch(shell, drive, arguments, told):
    with shell.started(f"{REPLAY} {arguments}") as launch:
        assert launch.wait(40.0) == 1
    assert told in launch.output
    assert "was required: shutting down" in launch.output
    assert "the replay publisher has ended with the exit code" in launch.output


@pytest.mark.parametrize("file", [TRACKER, DETECTOR, FOLLOW, f"{REPLAY} source:=drive.mcap"])
def test_a_wrong_argument_ends_the_launch_with_the_reason(shell, drive, file):
    outcome = shell.run(f"{file} seed:=some")
    assert outcome.returncode != 0
    told = outcome.stdout + outcome.stderr
    assert "argument seed:=some; allowed: int, 0 to 2147483647" in told
    assert "process started" not in told


@pytest.mark.parametrize("lockstep", ["true", "false"])
def test_a_replay_launch_ends_with_its_tracker(shell, drive, lockstep):
    broken = shell.folder / "broken.yaml"
    broken.write_text("pf_tracker: [")
    arguments = f"{TARGET} params_file:={broken} lockstep:={lockstep} loop:=true"
    with shell.started(f"{REPLAY} source:={drive} {arguments}") as launch:
        assert launch.wait(40.0) == 1
    assert "the tracker has ended with the exit code 1" in launch.output


def test_a_tracker_takes_the_preset_over_the_file_and_the_time_from_the_clock(shell, heard, drive):
    from diagnostic_msgs.msg import DiagnosticArray

    own = shell.folder / "own.yaml"
    own.write_text("/**:\n  ros__parameters:\n    preset: default\n    particles: 77\n")
    command = f"{TRACKER} params_file:={own} preset:=li2007 use_sim_time:=True autostart:=True"
    replay = f"ros2 run pf_tracker_ros replay {drive} --ros-args -p loop:=true"
    with shell.started(command) as launch, shell.started(f"{replay} -p publish_clock:=true"):
        status = heard(DiagnosticArray, "/pf_tracker/status")
        values = {item.key: item.value for item in status.status[0].values}
        assert values["preset"] == "li2007"
        assert launch.end() == 0
    assert "preset li2007; images on /image" in launch.output


def test_a_detector_is_heard_with_what_was_given(shell):
    pytest.importorskip("vision_msgs")
    arguments = "detections:=/yolo/detections labels:='[person, car]' max_targets:=5"
    command = f"{DETECTOR} {arguments} score_above:=0.4 namespace:=left log_level:=info"
    with shell.started(command) as launch:
        launch.wait_for("detections on /yolo/detections")
        launch.wait_for("targets on /left/pf_tracker/target")
        shell.wait_for_node("/left/pf_tracker")
        dumped = shell.run_until_answered("ros2 param dump /left/pf_tracker")
        for told in ("max_targets: 5", "score_above: 0.4", "- person", "- car"):
            assert told in dumped
        assert launch.end() == 0


def test_the_built_in_detector_of_people_needs_nothing_else(shell, heard, drive):
    pytest.importorskip("rclpy")
    from visualization_msgs.msg import MarkerArray

    command = f"{DETECTOR} built_in_detector:=people built_in_detector_rate:=5.0 seed:=2"
    replay = f"{RUN_REPLAY} {drive} --ros-args -p loop:=true"
    with shell.started(command) as launch, shell.started(replay):
        assert heard(MarkerArray, "/pf_tracker/boxes").markers
        assert launch.end() == 0


def test_the_selected_target_has_a_pose_in_meters(shell, heard, drive):
    """A target of 70 px before a camera with a focal length of 500 px is 1.75 m high."""
    from geometry_msgs.msg import PoseStamped

    calibration = "{width: 640, height: 480, k: [500, 0, 320, 0, 500, 240, 0, 0, 1]}"
    publish = "ros2 topic pub -r 5 /camera/camera_info sensor_msgs/msg/CameraInfo"
    follow = f"{FOLLOW} image:=/camera/image_raw {TARGET} camera_height:=1.5 fixed_frame:=map"
    # A box in the sky stands on no ground.
    replay = f"{RUN_REPLAY} {drive} --ros-args -r image:=/camera/image_raw -p loop:=true"
    with (
        shell.started(f"{follow} method:=height min_confidence:=0.2") as launch,
        shell.started(f'{publish} "{calibration}"'),
        shell.started(replay),
    ):
        pose = heard(PoseStamped, "/localizer/pose")
        assert pose.header.frame_id == "map"
        assert 8.0 < pose.pose.position.x < 18.0
        assert launch.end() == 0
    assert "camera_info on /camera/camera_info" in launch.output


@pytest.mark.parametrize("file", [TRACKER, DETECTOR])
def test_the_console_comes_with_the_tracker(shell, console_port, file):
    with shell.started(f"{file} console:=true namespace:=left") as launch:
        launch.wait_for(f"the console of /left/pf_tracker is at http://127.0.0.1:{console_port}/")
        launch.wait_for("targets on /left/pf_tracker/target")
        assert launch.end() == 0


def test_shipped_files_can_be_loaded_over_each_other(shell):
    share = "$(ros2 pkg prefix --share pf_tracker_ros)"
    presets = ["default", "li2007", "zhang2015", "zhang_bo"]
    with shell.started(f"{TRACKER} params_file:={share}/config/default.yaml") as launch:
        shell.wait_for_node("/pf_tracker")
        for preset in [*presets, "default"]:
            outcome = shell.run(f"ros2 param load /pf_tracker {share}/config/{preset}.yaml")
            assert outcome.returncode == 0, outcome.stderr
            dumped = shell.run_until_answered("ros2 param dump /pf_tracker")
            assert f"preset: {preset}\n" in dumped
            changed = f"preset {preset}, "
            assert changed not in launch.output
