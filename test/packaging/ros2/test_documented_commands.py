"""Every command of the first steps, how-to's and the node's page, as written and in order.

With the real `ros2`. Each command has its step; one that cannot be run everywhere has the reason.
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
    text = (REPOSITORY / document).read_text()
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [" ".join(line.split("#")[0].split()) for line in lines if line.strip()]


@dataclass(frozen=True)
class Step:
    """A command of a document.

    Attributes:
        part: Is in the command.
        prints: What the command prints; waited for, if it goes on.
        reason: Where a command is run that is not run here, or why nowhere.
        goes_on: Whether it goes on until one that `ends` it comes, or the document ends.
        node: Waited for before the next command.
        box: Topic on which a box comes once it runs.
        ends: Parts of the commands that are ended first, as with Ctrl-C.
        needs: A verb of `ros2` that not every machine has.
    """

    part: str
    prints: str = ""
    reason: str = ""
    goes_on: bool = False
    node: str = ""
    box: str = ""
    ends: tuple[str, ...] = ()
    needs: str = ""


def elsewhere(part, reason):
    return Step(part, reason=reason)


going_on = partial(Step, goes_on=True)
INSTALLED = "test_installations.py installs in this way without the network"
TARGET_TAKEN = "target 1 started on the box (42, 188, 44, 132)"
SET = "Set parameter successful"
TURNED = "Transitioning successful"
TRACKER, DETECTOR = "launch pf_tracker_ros tracker", "launch pf_tracker_ros detector"
FOLLOW, REPLAY = "launch pf_tracker_ros follow", "launch pf_tracker_ros replay"
INFO = "camera_info on /camera/camera_info"
COLOR = "/camera/camera/color"
DEPTH = "/camera/camera/aligned_depth_to_color/image_raw"

INSTALL = [
    elsewhere("git clone", INSTALLED),
    elsewhere("rosdep install", "installs packages on the machine"),
    Step("colcon build", "1 package finished"),
    Step("source install/setup.bash"),
]
DOCUMENTS = {
    "README.md": [
        elsewhere("make console", "test/node/console"),
        elsewhere("make demo", "test/demo"),
        elsewhere("make test", "this is it"),
        *INSTALL,
        going_on(TRACKER, "images on /camera/image_raw", node="/console"),
        Step("track drive.mcap", "tracked"),
        going_on(DETECTOR, "targets on /pf_tracker", ends=(TRACKER,)),
        going_on(FOLLOW, INFO, node="/localizer", ends=(DETECTOR,)),
    ],
    "docs/first_steps.md": [
        elsewhere(".venv/bin/track demo/hidden/hidden.mcap", "test/recordings"),
        *INSTALL,
        elsewhere("python3 -m venv ~/pf_tracker", INSTALLED),
        elsewhere("~/pf_tracker/bin/pip install '.[ros,", INSTALLED),
        going_on("tracker --ros-args", node="/pf_tracker"),
        going_on("replay drive.mcap", box="/pf_tracker/box"),
        Step("watch --once", "target 1  tracking"),
        Step("topic pub --once /pf_tracker/target", "publishing #1"),
        Step("param set /pf_tracker preset li2007", SET),
        going_on(REPLAY, TARGET_TAKEN, ends=("tracker --ros-args", "replay drive.mcap")),
        going_on(TRACKER, node="/pf_tracker", ends=(REPLAY,)),
    ],
    "docs/node.md": [
        going_on(DETECTOR, "targets on /pf_tracker", node="/pf_tracker"),
        Step("topic pub --once /pf_tracker/select", "publishing #1"),
        going_on(
            *("autostart:=false", "waiting to be configured"),
            **{"node": "/pf_tracker", "ends": (DETECTOR,)},
        ),
        Step("lifecycle set /pf_tracker configure", TURNED),
        Step("lifecycle set /pf_tracker activate", TURNED),
        Step("param set /pf_tracker preset zhang2015", SET),
        Step("param load /pf_tracker", "Set parameter preset successful"),
        Step("export FASTRTPS_DEFAULT_PROFILES_FILE="),
        Step("topic echo --once --full-length /diagnostics", "last_error"),
    ],
    "docs/usb_camera.md": [
        elsewhere("usb_cam_node_exe", "needs a camera"),
        going_on(TRACKER, node="/pf_tracker"),
        elsewhere("watch", "needs a camera"),
        going_on("namespace:=left", node="/left/pf_tracker", ends=("console:=true",)),
        going_on("namespace:=right", node="/right/pf_tracker"),
        Step("topic pub --once /left/pf_tracker/target", "publishing #1"),
    ],
    "docs/depth_camera.md": [
        elsewhere("ros2 launch realsense2_camera", "needs a camera"),
        going_on(FOLLOW, f"camera_info on {COLOR}/camera_info, depth on {DEPTH}, odom on /odom"),
        elsewhere("watch", "test_watch.py"),
    ],
    "docs/thermal_camera.md": [going_on(TRACKER, "images on /thermal/image_raw")],
    "docs/yolo.md": [
        going_on(DETECTOR, "targets on /pf_tracker", node="/pf_tracker"),
        elsewhere("tracker --ros-args", "for an environment without the command ros2"),
    ],
    "docs/bag.md": [
        going_on("ros2 bag record -s mcap /camera", needs="bag"),
        elsewhere("--storage-config-file", "needs rosbag2 with the storage plugin for MCAP"),
        going_on(TRACKER, node="/pf_tracker", ends=("ros2 bag",)),
        going_on("console rosbag2_2026_01_01", node="/console"),
        going_on(REPLAY, TARGET_TAKEN, ends=(TRACKER, "console rosbag2")),
    ],
    "docs/docker.md": [
        elsewhere(part, "needs Docker")
        for part in ("build -t", "-e ROS_DOMAIN_ID", "watch", "track /data/drive.mcap")
    ],
    "docs/localizer.md": [
        going_on(FOLLOW, INFO, node="/localizer"),
        elsewhere("watch", "test_watch.py"),
    ],
    "docs/follow_a_person.md": [
        going_on(FOLLOW, "camera_info on /camera/color/camera_info", node="/localizer"),
        *(
            elsewhere(f"~/pf_tracker/bin/{part}", "for an environment without the command ros2")
            for part in ("tracker", "localizer", "python examples/follow_person.py")
        ),
        elsewhere("python3 examples/follow_person.py", "test_follow_person.py"),
        elsewhere("ros2 action send_goal", "needs Nav2"),
    ],
    "docs/recipes.md": [
        going_on("localizer --ros-args", INFO, node="/localizer"),
        elsewhere("python3 examples/gimbal.py", "test_gimbal.py"),
        elsewhere("rviz2", "opens a window; test_displays.py"),
        elsewhere("rviz2", "opens a window; test_displays.py"),
    ],
    "docs/benchmarks.md": [Step("evaluate sequences", "moving_square")],
}


def steps_of(document):
    """Each command of a document with its step."""
    return list(zip(commands_of(document), DOCUMENTS[document], strict=True))


@pytest.mark.parametrize("document", DOCUMENTS)
def test_each_command_of_the_document_has_its_step_and_each_step_its_command(document):
    for command, step in steps_of(document):
        assert step.part in command


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
        for command, step in steps_of(document):
            if step.reason:
                continue
            if step.needs and shell.run(f"ros2 {step.needs} --help").returncode:
                continue
            if not step.goes_on:
                outcome = shell.run(command)
                assert outcome.returncode == 0, outcome.stdout + outcome.stderr
                assert step.prints in outcome.stdout + outcome.stderr
                continue
            for ended in [one for one in running_ones if any(part in one for part in step.ends)]:
                assert running_ones.pop(ended).end() == 0, ended
            running_ones[command] = running = last.enter_context(shell.started(command))
            running.wait_for(step.prints)
            if step.node:
                shell.wait_for_node(step.node)
            if step.box:
                heard(PolygonStamped, step.box)
        for command, running in running_ones.items():
            assert running.end() == 0, command
