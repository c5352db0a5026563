"""Every command of the first steps, how-to's and the node's page, as written and in order.

With the real `ros2`.

Each command has its step here; one that cannot be run everywhere has the reason.
"""

import contextlib
import re
import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]


def commands_of(document):
    """The commands in the shell blocks of a document, their continued lines joined."""
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", document.read_text(), re.MULTILINE | re.DOTALL)
    text = "".join(blocks).replace("\\\n", " ")
    return [" ".join(line.split("#")[0].split()) for line in text.splitlines() if line.strip()]


@dataclass(frozen=True)
class Step:
    """A command of a document.

    Attributes:
        shows: What a command that ends prints.
        reason: Where a command is run that is not run here, or why nowhere.
        goes_on: Whether it goes on until one that `ends` it comes, or the document ends.
        node: Waited for before the next command.
        prints: Waited for as well, in what a command that goes on prints.
        box: Topic on which a box comes once it runs.
        ends: Beginnings of the commands that are ended first, as with Ctrl-C.
        needs: A verb of `ros2` that not every machine has.
    """

    command: str
    shows: str = ""
    reason: str = ""
    goes_on: bool = False
    node: str = ""
    prints: str = ""
    box: str = ""
    ends: tuple[str, ...] = ()
    needs: str = ""


def elsewhere(command, reason):
    return Step(command, reason=reason)


going_on = partial(Step, goes_on=True)


INSTALLED = "test_installations.py installs in this way without the network"
POLYGON = (
    'geometry_msgs/msg/PolygonStamped "{polygon: {points: [{x: 42, y: 188}, {x: 86, y: 320}]}}"'
)
BLUE_COAT = (
    'geometry_msgs/msg/PolygonStamped "{polygon: {points: [{x: 230, y: 180}, {x: 272, y: 322}]}}"'
)
RUN, LAUNCH = "ros2 run pf_tracker_ros", "ros2 launch pf_tracker_ros"
TARGET_TAKEN = "target 1 started on the box (42, 188, 44, 132)"
SHARE = "$(ros2 pkg prefix --share pf_tracker_ros)"

SEVERAL = f"{LAUNCH} detector.launch.py image:=/camera/image_raw detections:=/yolo/detections"

TRACK_CONSOLE = f"{LAUNCH} tracker.launch.py image:=/camera/image_raw console:=true"
INSTALL = [
    elsewhere(
        "git clone https://github.com/pf-tracker-ros/pf_tracker_ros src/pf_tracker_ros", INSTALLED
    ),
    elsewhere("rosdep install --from-paths src --ignore-src", "installs packages on the machine"),
    Step("colcon build --packages-select pf_tracker_ros", "1 package finished"),
    Step("source install/setup.bash"),
]

README = [
    elsewhere("make console", "test/node/console"),
    elsewhere("make demo", "test/demo"),
    elsewhere("make test", "this is it"),
    *INSTALL,
    going_on(TRACK_CONSOLE, node="/console", prints="images on /camera/image_raw"),
    Step(
        f"{RUN} track drive.mcap --box 42,188,44,132 --output tracked --video --report",
        "tracked",
    ),
    going_on(SEVERAL, prints="targets on /pf_tracker", ends=(f"{LAUNCH} tracker",)),
    going_on(
        f"{LAUNCH} follow.launch.py image:=/camera/image_raw camera_height:=1.2 "
        "built_in_detector:=people",
        node="/localizer",
        prints="camera_info on /camera/camera_info",
        ends=(f"{LAUNCH} detector",),
    ),
]

FIRST_STEPS = [
    elsewhere(
        ".venv/bin/track demo/hidden/hidden.mcap --box 42,188,44,132 --output tracked --video "
        "--report",
        "test/recordings",
    ),
    *INSTALL,
    elsewhere("python3 -m venv ~/pf_tracker", INSTALLED),
    elsewhere("~/pf_tracker/bin/pip install '.[ros,console,recordings,evaluation]'", INSTALLED),
    going_on(f"{RUN} tracker --ros-args -r image:=/camera/image_raw", node="/pf_tracker"),
    going_on(
        f"{RUN} replay drive.mcap --ros-args -r image:=/camera/image_raw -p loop:=true "
        '-p target_box:="[42, 188, 44, 132]"',
        box="/pf_tracker/box",
    ),
    Step(f"{RUN} watch --once", "target 1  tracking"),
    Step(f"ros2 topic pub --once /pf_tracker/target {BLUE_COAT}", "publishing #1"),
    Step("ros2 param set /pf_tracker preset li2007", "Set parameter successful"),
    going_on(
        f'{LAUNCH} replay.launch.py source:=drive.mcap target_box:="[42, 188, 44, 132]"',
        prints=TARGET_TAKEN,
        ends=(f"{RUN} tracker", f"{RUN} replay"),
    ),
    going_on(
        f"{LAUNCH} tracker.launch.py image:=/camera/image_raw preset:=li2007",
        node="/pf_tracker",
        ends=(f"{LAUNCH} replay",),
    ),
]

BENCHMARKS = [
    Step(
        f"{RUN} evaluate sequences --preset default --seeds 3 --output result.json "
        "--plot success.png",
        "moving_square",
    ),
]

NODE = [
    going_on(f"{SEVERAL} labels:=person,car", node="/pf_tracker", prints="targets on /pf_tracker"),
    Step(
        'ros2 topic pub --once /pf_tracker/select std_msgs/msg/UInt32 "{data: 1}"',
        "publishing #1",
    ),
    going_on(
        f"{RUN} tracker --ros-args -p autostart:=false",
        node="/pf_tracker",
        prints="waiting to be configured",
        ends=(f"{LAUNCH} detector",),
    ),
    Step("ros2 lifecycle set /pf_tracker configure", "Transitioning successful"),
    Step("ros2 lifecycle set /pf_tracker activate", "Transitioning successful"),
    Step("ros2 param set /pf_tracker preset zhang2015", "Set parameter successful"),
    Step(
        f"ros2 param load /pf_tracker {SHARE}/config/li2007.yaml",
        "Set parameter preset successful",
    ),
    Step(f"export FASTRTPS_DEFAULT_PROFILES_FILE={SHARE}/config/fastdds_large_images.xml"),
    Step("ros2 topic echo --once --full-length /diagnostics", "last_error"),
]

USB_CAMERA = [
    elsewhere("ros2 run usb_cam usb_cam_node_exe --ros-args -r __ns:=/camera", "needs a camera"),
    going_on(TRACK_CONSOLE, node="/pf_tracker"),
    elsewhere(f"{RUN} watch", "needs a camera"),
    going_on(
        f"{LAUNCH} tracker.launch.py namespace:=left image:=/left/image_raw",
        node="/left/pf_tracker",
        ends=(f"{LAUNCH} tracker",),
    ),
    going_on(
        f"{LAUNCH} tracker.launch.py namespace:=right image:=/right/image_raw preset:=zhang2015",
        node="/right/pf_tracker",
    ),
    Step(f"ros2 topic pub --once /left/pf_tracker/target {POLYGON}", "publishing #1"),
]

DEPTH_CAMERA = [
    elsewhere(
        "ros2 launch realsense2_camera rs_launch.py align_depth.enable:=true", "needs a camera"
    ),
    going_on(
        f"{LAUNCH} follow.launch.py image:=/camera/camera/color/image_raw "
        "depth:=/camera/camera/aligned_depth_to_color/image_raw odom:=/odom camera_height:=0.6",
        prints="camera_info on /camera/camera/color/camera_info, depth on "
        "/camera/camera/aligned_depth_to_color/image_raw, odom on /odom",
    ),
    elsewhere(f"{RUN} watch", "test_watch.py"),
]

LOCALIZER = [
    going_on(
        f"{LAUNCH} follow.launch.py image:=/camera/image_raw camera_height:=1.2 "
        "built_in_detector:=people",
        node="/localizer",
        prints="camera_info on /camera/camera_info",
    ),
    elsewhere(f"{RUN} watch", "test_watch.py"),
]

THERMAL_CAMERA = [
    going_on(
        f"{LAUNCH} tracker.launch.py image:=/thermal/image_raw console:=true",
        prints="images on /thermal/image_raw",
    ),
]

YOLO = [
    going_on(f"{SEVERAL} labels:=person,car", node="/pf_tracker", prints="targets on /pf_tracker"),
    elsewhere(
        "tracker --ros-args -r image:=/camera/image_raw -r detections:=/yolo/detections "
        "-p max_targets:=32 -p \"detector.labels:=['person', 'car']\"",
        "for an environment without the command ros2",
    ),
]

BAG = [
    going_on(
        "ros2 bag record -s mcap /camera/image_raw /pf_tracker/box /pf_tracker/status",
        needs="bag",
    ),
    elsewhere(
        f"ros2 bag record -s mcap --storage-config-file {SHARE}/config/rosbag2_record.yaml "
        "/camera/image_raw /camera/camera_info /odom /imu /tf /tf_static /pf_tracker/status "
        "/pf_tracker/boxes",
        "needs rosbag2 with the storage plugin for MCAP",
    ),
    going_on(f"{LAUNCH} tracker.launch.py", node="/pf_tracker", ends=("ros2 bag",)),
    going_on(f"{RUN} console rosbag2_2026_01_01", node="/console"),
    going_on(
        f"{LAUNCH} replay.launch.py source:=rosbag2_2026_01_01 bag_topic:=/camera/image_raw "
        'lockstep:=true target_box:="[42, 188, 44, 132]"',
        prints=TARGET_TAKEN,
        ends=(f"{LAUNCH} tracker", f"{RUN} console"),
    ),
]

DOCKER = [
    elsewhere(command, "needs Docker")
    for command in (
        "docker build -t pf_tracker .",
        "docker run --rm --network host --ipc host -e ROS_DOMAIN_ID pf_tracker",
        f"docker run --rm --network host --ipc host pf_tracker {RUN} watch",
        f"docker run --rm -v $PWD:/data pf_tracker {RUN} track /data/drive.mcap "
        "--box 42,188,44,132 --output /data/tracked",
    )
]

FOLLOW = [
    going_on(
        f"{LAUNCH} follow.launch.py image:=/camera/color/image_raw "
        "depth:=/camera/aligned_depth_to_color/image_raw odom:=/odom camera_height:=0.6 "
        "detections:=/yolo/detections labels:=person score_above:=0.4 console:=true",
        node="/localizer",
        prints="camera_info on /camera/color/camera_info",
    ),
    elsewhere(
        "python3 examples/follow_person.py --ros-args -r odom:=/odom -r cmd_vel:=/cmd_vel "
        "-p distance:=2.0 -p fastest:=0.8",
        "test_follow_person.py",
    ),
    elsewhere(
        "ros2 action send_goal /follow_object nav2_msgs/action/FollowObject "
        '"{pose_topic: /localizer/pose}"',
        "needs Nav2",
    ),
]
RECIPES = [
    going_on(
        f"{RUN} localizer --ros-args -r camera_info:=/camera/camera_info",
        node="/localizer",
        prints="camera_info on /camera/camera_info",
    ),
    elsewhere(
        "python3 examples/gimbal.py --ros-args -r cmd_vel:=/gimbal/cmd_vel", "test_gimbal.py"
    ),
    elsewhere(f"rviz2 -d {SHARE}/config/tracker.rviz", "opens a window; test_displays.py"),
    elsewhere(f"rviz2 -d {SHARE}/config/localizer.rviz", "opens a window; test_displays.py"),
]
DOCUMENTS = {
    "README.md": README,
    "docs/first_steps.md": FIRST_STEPS,
    "docs/node.md": NODE,
    "docs/usb_camera.md": USB_CAMERA,
    "docs/depth_camera.md": DEPTH_CAMERA,
    "docs/thermal_camera.md": THERMAL_CAMERA,
    "docs/yolo.md": YOLO,
    "docs/bag.md": BAG,
    "docs/docker.md": DOCKER,
    "docs/localizer.md": LOCALIZER,
    "docs/follow_a_person.md": FOLLOW,
    "docs/recipes.md": RECIPES,
    "docs/benchmarks.md": BENCHMARKS,
}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_each_command_of_the_document_has_its_step_and_each_step_its_command(document):
    written = commands_of(REPOSITORY / document)
    assert written == [step.command for step in DOCUMENTS[document]]


@pytest.fixture
def prepared(shell, workspace, record_drive, write_sequence, moving_square):
    """The shell in a folder with all that the documents take for granted to be there."""
    shutil.copytree(workspace / "src", shell.folder / "src")
    sequences = shell.folder / "sequences"
    write_sequence("moving_square", moving_square.images, moving_square.boxes, sequences)
    record_drive("drive.mcap")
    record_drive("rosbag2_2026_01_01")
    return shell


@pytest.mark.usefixtures("console_port")
@pytest.mark.parametrize("document", DOCUMENTS)
def test_the_commands_work_as_written_and_in_order(prepared, heard, document):
    from geometry_msgs.msg import PolygonStamped

    shell = prepared
    with contextlib.ExitStack() as last:
        running_ones = {}
        for step in DOCUMENTS[document]:
            if step.reason:
                continue
            if step.needs and shell.run(f"ros2 {step.needs} --help").returncode:
                continue
            if not step.goes_on:
                outcome = shell.run(step.command)
                assert outcome.returncode == 0, outcome.stdout + outcome.stderr
                assert step.shows in outcome.stdout + outcome.stderr
                continue
            for command in [one for one in running_ones if one.startswith(step.ends)]:
                assert running_ones.pop(command).end() == 0, command
            running_ones[step.command] = running = last.enter_context(shell.started(step.command))
            running.wait_for(step.prints)
            if step.node:
                shell.wait_for_node(step.node)
            if step.box:
                heard(PolygonStamped, step.box)
        for command, running in running_ones.items():
            assert running.end() == 0, command
