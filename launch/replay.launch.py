"""Replay a recording as a camera's topic, into a tracker unless told otherwise.

For example, a video whose target is drawn as a box in its first frame::

    ros2 launch pf_tracker_ros replay.launch.py source:=clip.mp4 target_box:="[62, 31, 53, 70]"

The launch ends with the recording, and fails if that cannot be played.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from pf_tracker_ros.launching import PACKAGE, LaunchArguments, argument, shared_arguments
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.parameters import declarations

TEXTS = ("bag_topic",)
FLAGS = ("loop", "start_paused", "lockstep", "target_from_ground_truth", "publish_clock")
# Handed on to the tracker as they are.
FORWARDED_ARGUMENTS = (
    "namespace",
    "preset",
    "params_file",
    "image_transport",
    "seed",
    "large_images",
    "log_level",
    "console",
    "console_port",
)


def start_replay(context: LaunchContext) -> list[Node | GroupAction | RegisterEventHandler]:
    """The replay publisher with what was given, and the tracker that it plays to."""
    given = LaunchArguments(context)
    parameters = {name: ParameterValue(given.text(name), value_type=str) for name in TEXTS}
    parameters |= {name: given.flag(name) for name in FLAGS}
    parameters["rate"] = given.parameter("rate", declarations(ReplayParameters)["rate"])
    if box := given.box("target_box"):
        parameters["target_box"] = box
    image = given.text("image")
    replay = Node(
        executable="replay",
        name="replay",
        parameters=[parameters],
        remappings=[("image", image), ("image/compressed", f"{image}/compressed")],
        # Not as a parameter: so the launch ends at once if it cannot be played.
        arguments=[given.text("source"), *given.log_arguments()],
        on_exit=[
            Shutdown(reason="the replay has ended"),
            OpaqueFunction(function=fail_with, args=["replay publisher"]),
        ],
        **given.common_node_options(),
    )
    if not given.flag("tracker"):
        return [replay]
    launch_file = Path(get_package_share_directory(PACKAGE)) / "launch" / "tracker.launch.py"
    tracker = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(launch_file)),
        launch_arguments={
            **{name: given.text(name) for name in FORWARDED_ARGUMENTS},
            "image": image,
            # The replay publisher sends the target, after which it plays the first frame.
            "target_box": "",
            "image_reliability": "",
            "autostart": "true",
            "use_sim_time": given.text("publish_clock"),
        }.items(),
    )
    # A group, because the tracker's arguments would otherwise replace those of the same name here.
    # It comes first: where an argument is wrong, nothing runs that would outlive the launch.
    # Without a tracker the replay would wait for one, or play to nobody.
    watch = RegisterEventHandler(
        OnProcessExit(
            target_action=lambda action: getattr(action, "node_executable", "") == "tracker",
            on_exit=[
                Shutdown(reason="the tracker has ended"),
                OpaqueFunction(function=fail_with, args=["tracker"]),
            ],
        )
    )
    return [watch, GroupAction([tracker]), replay]


def fail_with(context: LaunchContext, name: str) -> None:
    """Let the launch fail where a process of it has ended by itself with an error."""
    code = context.locals.event.returncode
    if code and not context.is_shutdown:
        raise RuntimeError(f"the {name} has ended with the exit code {code}")


def generate_launch_description() -> LaunchDescription:
    """Arguments, the replay publisher and the tracker."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "source",
                description="A rosbag2 folder or .mcap file, a video, a folder of images or a "
                "sequence folder.",
            ),
            argument(
                "bag_topic", "Image topic of the bag; empty takes the only one that there is."
            ),
            argument("rate", "Speed relative to the recording.", default="1.0"),
            argument("loop", "Begin again at the end.", default="false"),
            argument(
                "start_paused", "Wait for the service ~/pause before the first frame.", "false"
            ),
            argument(
                "lockstep", "Play each frame after the tracker's answer to the last.", "false"
            ),
            argument("target_box", "Target in the first frame, [x, y, width, height] in pixels."),
            argument(
                "target_from_ground_truth",
                "Take the target from the source's ground truth.",
                default="false",
            ),
            argument(
                "publish_clock",
                "Publish the recording's time on /clock, and track by it.",
                default="false",
            ),
            *shared_arguments("image"),
            argument("namespace", "Namespace of both nodes."),
            argument("tracker", "Start a tracker as well.", default="true"),
            argument(
                "console",
                "Serve the tracker's page on the loopback as long as the replay runs.",
                default="false",
            ),
            *shared_arguments("console_port"),
            argument("preset", "Preset of the tracker."),
            argument("params_file", "ROS parameter file of the tracker."),
            argument(
                "image_transport",
                "compressed for a bag of compressed images; else the tracker takes raw ones.",
            ),
            argument("seed", "Seeds all randomness of the tracker."),
            argument(
                "large_images",
                "Use the Fast DDS profile for large images in both nodes.",
                default="false",
            ),
            argument("log_level", "debug, info, warn, error or fatal, of both nodes."),
            OpaqueFunction(function=start_replay),
        ]
    )
