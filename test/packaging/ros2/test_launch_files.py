"""The launch files: their arguments everywhere, and what they start where launch is installed."""

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
LAUNCH_FILES = sorted((REPOSITORY / "launch").glob("*.launch.py"))
SHARING = REPOSITORY / "pf_tracker_ros" / "launching.py"
DECLARING = ("DeclareLaunchArgument", "argument")
TRACKER = "ros2 launch pf_tracker_ros tracker.launch.py"
REPLAY = "ros2 launch pf_tracker_ros replay.launch.py"
DETECTOR = "ros2 launch pf_tracker_ros detector.launch.py"
FOLLOW = "ros2 launch pf_tracker_ros follow.launch.py"
RUN_REPLAY = "ros2 run pf_tracker_ros replay"
TARGET = 'target_box:="[42, 188, 44, 132]"'

each_launch_file = pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)


def parsed(path):
    tree = ast.parse(path.read_text())
    compile(tree, str(path), "exec")
    return tree


def calls(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


def constants(tree):
    """The values of the constants of a module that are written out."""
    return {
        statement.targets[0].id: ast.literal_eval(statement.value)
        for statement in tree.body
        if isinstance(statement, ast.Assign)
    }


def called(call):
    """Name of the called function or method of `LaunchArguments`; None for any other."""
    if isinstance(call.func, ast.Attribute):
        of_given = getattr(call.func.value, "id", "") in ("given", "self")
        return call.func.attr if of_given else None
    return getattr(call.func, "id", None)


def words(call):
    """The texts in a call, those of shared constants included."""
    found = {word.value for word in call.args if isinstance(word, ast.Constant)}
    shared = constants(parsed(SHARING))
    starred = [getattr(word.value, "id", "") for word in call.args if isinstance(word, ast.Starred)]
    return found.union(*(shared[name] for name in starred if name in shared))


def shared_words(tree):
    """Names of the shared arguments that a launch file declares."""
    return [
        name for call in calls(tree) if called(call) == "shared_arguments" for name in words(call)
    ]


def declared(tree):
    """Names of the arguments that a launch file declares."""
    names = {call.args[0].value for call in calls(tree) if called(call) in DECLARING}
    return names.union(shared_words(tree))


def reached(tree):
    """A launch file, and all functions and methods of what is shared that it comes to call."""
    sharing = ast.walk(parsed(SHARING))
    shared = {node.name: node for node in sharing if isinstance(node, ast.FunctionDef)}
    found, names = [tree], {*DECLARING, "shared_arguments"}
    for node in found:
        for name in {called(call) for call in calls(node)} & shared.keys() - names:
            names.add(name)
            found.append(shared[name])
    return found


def read(tree):
    """Names of the arguments that a launch file reads, itself or by what it calls."""
    listed = constants(parsed(SHARING)) | constants(tree)
    found = set()
    for part in reached(tree):
        declaring = [call for call in calls(part) if called(call) == "shared_arguments"]
        declared_here = {node for call in declaring for node in ast.walk(call)}
        for node in set(ast.walk(part)) - declared_here:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                names = listed.get(node.id)
                found |= {*names} if isinstance(names, tuple) else set()
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                found |= words(node) if called(node) else set()
    return found


def parameters_set(tree):
    """Names of the node's parameters that a launch file sets one by one, itself or by calls."""
    return {
        node.slice.value
        for part in reached(tree)
        for node in ast.walk(part)
        if isinstance(node, ast.Subscript)
        and getattr(node.value, "id", "") == "parameters"
        and isinstance(node.slice, ast.Constant)
    }


@each_launch_file
def test_each_argument_that_is_read_is_declared_and_each_declared_one_is_read(path):
    tree = parsed(path)
    assert read(tree) == declared(tree)


def test_what_is_shared_is_read_where_it_is_called():
    names = [f"{name}.launch.py" for name in ("detector", "follow", "replay", "tracker")]
    assert [path.name for path in LAUNCH_FILES] == names
    detector, follow, replay, tracker = map(parsed, LAUNCH_FILES)
    both = {"image_reliability", "params_file", "console", "use_sim_time", "log_level", "seed"}
    assert both <= read(detector) & read(follow) & read(tracker)
    assert "large_images" in read(replay)
    assert "use_sim_time" not in read(replay)
    assert {"preset", "seed"} <= {*constants(parsed(SHARING))["TRACKER_PARAMETERS"]}
    assert parameters_set(replay) == {"rate", "target_box"}
    # The replay publisher hands the tracker only arguments that it has.
    (handed,) = [
        keyword.value.func.value
        for call in calls(replay)
        for keyword in call.keywords
        if keyword.arg == "launch_arguments"
    ]
    given = {key.value for key in handed.keys if key is not None}
    assert given | {*constants(replay)["FORWARDED_ARGUMENTS"]} == declared(tracker)


def test_each_shared_argument_is_described_and_declared_by_several_files():
    named = [shared_words(parsed(path)) for path in LAUNCH_FILES]
    described = constants(parsed(SHARING))["_SHARED"]
    for name, (description, default) in described.items():
        assert sum(name in names for names in named) > 1
        assert description.endswith(".")
        assert default in ("", "false", name)
    assert described.keys() == {name for names in named for name in names}


def test_the_parameters_that_are_set_exist_and_have_the_type_that_is_given():
    pytest.importorskip("rclpy")
    from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
    from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
    from pf_tracker_ros.node_parameters import NodeParameters
    from pf_tracker_ros.parameters import declarations
    from pf_tracker_ros.tracking.parameters import TrackerParameters

    of_node = declarations(NodeParameters)
    of_tracker = of_node | declarations(TrackerParameters)
    of_localizer = declarations(LocalizerParameters)
    of_replay = declarations(ReplayParameters)
    of_each = of_tracker, of_tracker | of_localizer, of_replay, of_node
    shared = constants(parsed(SHARING))
    for path, known in zip(LAUNCH_FILES, of_each, strict=True):
        tree = parsed(path)
        assert parameters_set(tree) <= known.keys()
        values = shared | constants(tree)
        assert all(known[name].type is str for name in values.get("TEXTS", ()))
        assert all(known[name].type is bool for name in values.get("FLAGS", ()))
    assert {*shared["TRACKER_PARAMETERS"], *shared["DETECTOR_PARAMETERS"]} <= of_node.keys()
    underscored = {name.replace(".", "_") for name in of_localizer}
    assert {*shared["LOCALIZER_PARAMETERS"]} == underscored - {"autostart", "rectified"}


# From here on the launch files are run.


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


@pytest.mark.parametrize(
    ("file", "given", "allowed"),
    [
        (TRACKER, "use_sim_time:=perhaps", "true or false"),
        (TRACKER, "console:=perhaps", "true or false"),
        (TRACKER, "seed:=some", "int, 0 to 2147483647"),
        (TRACKER, "seed:=-5", "int, 0 to 2147483647"),
        (TRACKER, "log_level:=loud", "debug, info"),
        (TRACKER, "console_port:=web", "int, 0 to 65535"),
        (TRACKER, "console_port:=99999", "int, 0 to 65535"),
        (TRACKER, "target_box:=[1,2]", "[x, y, width, height]"),
        (TRACKER, "target_box:=[1,2,-3,4]", "[x, y, width, height] in pixels, width and height"),
        (TRACKER, "image_transport:=jpeg", "raw, compressed"),
        (TRACKER, "params_file:=none.yaml", ""),
        (TRACKER, "preset:=lee2007", "default, learned, li2007"),
        (DETECTOR, "max_targets:=many", "a number, int"),
        (DETECTOR, "score_above:=high", "a number, float"),
        (DETECTOR, "score_above:=7", "float, 0 to 1"),
        (DETECTOR, "max_targets:=0", "int, 1 to 1000"),
        (DETECTOR, "preset:=lee2007", "default, learned, li2007"),
        (DETECTOR, "built_in_detector:=cars", "none, people, motion"),
        (FOLLOW, "camera_height:=tall", "a number, float"),
        (FOLLOW, "camera_height:=-1", "float, 0 to 1000"),
        (FOLLOW, "method:=radar", "auto, ground, height, depth"),
        (FOLLOW, "rectified:=perhaps", "true or false"),
        (FOLLOW, "max_targets:=0", "int, 1 to 1000"),
        # Of the tracker that a replay starts.
        (f"{REPLAY} source:=drive.mcap {TARGET}", "seed:=some", "int, 0 to 2147483647"),
        (f"{REPLAY} source:=drive.mcap {TARGET}", "params_file:=none.yaml", ""),
    ],
)
def test_a_wrong_argument_ends_the_launch_with_the_reason(shell, drive, file, given, allowed):
    console = "console:=true " if given.startswith("console_port") else ""
    outcome = shell.run(f"{file} {console}{given}")
    told = f"allowed: {allowed}" if allowed else "the file does not exist"
    assert outcome.returncode != 0
    assert f"argument {given}; {told}" in outcome.stdout + outcome.stderr
    assert "process started" not in outcome.stdout + outcome.stderr


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
