"""Replay a recording as a camera's topic, by default with a tracker.

For example, a video whose target is drawn as a box in its first frame::

    ros2 launch pf_tracker_ros replay.launch.py source:=clip.mp4 target_box:="[42, 188, 44, 132]"

The launch ends with the recording, and fails if the recording cannot be played.
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
# Passed to the tracker unchanged.
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
    """The replay publisher with the given arguments, and its tracker."""
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
        # Not as a parameter: the launch ends at once if the source cannot be played.
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
            # The replay publisher sends the target before the first frame.
            "target_box": "",
            "image_reliability": "",
            "autostart": "true",
            "use_sim_time": given.text("publish_clock"),
        }.items(),
    )
    # Without a tracker the replay would wait for one, or play to no subscriber.
    on_tracker_exit = RegisterEventHandler(
        OnProcessExit(
            target_action=lambda action: getattr(action, "node_executable", "") == "tracker",
            on_exit=[
                Shutdown(reason="the tracker has ended"),
                OpaqueFunction(function=fail_with, args=["tracker"]),
            ],
        )
    )
    # A group keeps the tracker's arguments from replacing those of the same name here. It precedes
    # the replay: after an invalid argument no process outlives the launch.
    return [on_tracker_exit, GroupAction([tracker]), replay]


def fail_with(context: LaunchContext, name: str) -> None:
    """Let the launch fail after a process that ended by itself with an error."""
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
            argument("bag_topic", "Image topic of the bag; empty if it has only one."),
            argument("rate", "Speed relative to the recording.", default="1.0"),
            argument("loop", "Start again at the end.", default="false"),
            argument(
                "start_paused", "Wait for the service ~/pause before the first frame.", "false"
            ),
            argument(
                "lockstep",
                "Publish each frame after the tracker's status of the last one.",
                "false",
            ),
            argument("target_box", "Target in the first frame, [x, y, width, height] in pixels."),
            argument(
                "target_from_ground_truth",
                "Start the target on the first box of the ground truth.",
                default="false",
            ),
            argument(
                "publish_clock",
                "Publish the recording's time on /clock; the tracker uses it.",
                default="false",
            ),
            *shared_arguments("image"),
            argument("namespace", "Namespace of both nodes."),
            argument("tracker", "Start a tracker as well.", default="true"),
            argument(
                "console",
                "Serve the console on the loopback interface during the replay.",
                default="false",
            ),
            *shared_arguments("console_port"),
            argument("preset", "Preset of the tracker."),
            argument("params_file", "ROS parameter file of the tracker."),
            argument(
                "image_transport",
                "compressed for a bag of compressed images; empty expects raw ones.",
            ),
            argument("seed", "Seed of all random numbers of the tracker."),
            argument(
                "large_images",
                "Use the Fast DDS profile for large images in both nodes.",
                default="false",
            ),
            argument("log_level", "Log level of both nodes: debug, info, warn, error or fatal."),
            OpaqueFunction(function=start_replay),
        ]
    )
