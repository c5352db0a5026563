"""Replay a recording as a camera's topic, into a tracker unless told otherwise.

For example, a video whose target is drawn as a box in its first frame::

    ros2 launch pf_tracker_ros replay.launch.py source:=clip.mp4 target_box:="[293, 97, 115, 82]"
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "pf_tracker_ros"
BOOLEAN = ["true", "false"]
TEXTS = ("source", "bag_topic")
FLAGS = ("loop", "start_paused", "lockstep", "target_from_ground_truth", "publish_clock")


def start_replay(context: LaunchContext) -> list[Node | GroupAction]:
    """The replay publisher with what was given, and the tracker that it plays to."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    share = Path(get_package_share_directory(PACKAGE))
    parameters = {name: ParameterValue(given(name), value_type=str) for name in TEXTS}
    parameters |= {name: given(name) == "true" for name in FLAGS}
    parameters["rate"] = ParameterValue(given("rate"), value_type=float)
    if given("target_box"):
        parameters["target_box"] = box(given("target_box"))
    environment = {}
    if given("large_images") == "true":
        profile = share / "config/fastdds_large_images.xml"
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profile)
    image = given("image")
    replay = Node(
        package=PACKAGE,
        executable="replay",
        name="replay",
        namespace=given("namespace") or None,
        parameters=[parameters],
        remappings=[("image", image), ("image/compressed", f"{image}/compressed")],
        additional_env=environment,
        output="screen",
        emulate_tty=True,
    )
    if given("tracker") == "false":
        return [replay]
    tracker = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / "launch" / "tracker.launch.py")),
        launch_arguments={
            "image": image,
            "namespace": given("namespace"),
            "preset": given("preset"),
            "params_file": given("params_file"),
            # The replay publisher sends the target, after which it plays the first frame.
            "target_box": "",
            # Lockstep waits for every frame, so none may be dropped on the way.
            "image_reliability": "reliable" if given("lockstep") == "true" else "",
            "image_transport": given("image_transport"),
            "autostart": "true",
            "use_sim_time": given("publish_clock"),
            "large_images": given("large_images"),
        }.items(),
    )
    # A group, because the tracker's arguments would otherwise replace those of the same name here.
    return [replay, GroupAction([tracker])]


def box(text: str) -> list[float] | ParameterValue:
    """Four numbers with or without brackets; any other text is left for the node to refuse."""
    try:
        return [float(part) for part in text.strip("[] ").split(",")]
    except ValueError:
        return ParameterValue(text, value_type=str)


def flag(name: str, description: str, default_value: str = "false") -> DeclareLaunchArgument:
    """An argument that is true or false."""
    return DeclareLaunchArgument(
        name, default_value=default_value, choices=BOOLEAN, description=description
    )


def generate_launch_description() -> LaunchDescription:
    """Arguments, the replay publisher and the tracker."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "source",
                description="A rosbag2 folder or .mcap file, a video, a folder of images or a "
                "sequence folder.",
            ),
            DeclareLaunchArgument(
                "bag_topic",
                default_value="",
                description="Image topic of the bag; empty takes the only one that there is.",
            ),
            DeclareLaunchArgument(
                "rate", default_value="1.0", description="Speed relative to the recording."
            ),
            flag("loop", "Begin again at the end."),
            flag("start_paused", "Wait for the service ~/pause before the first frame."),
            flag("lockstep", "Play each frame after the tracker's answer to the last one."),
            DeclareLaunchArgument(
                "target_box",
                default_value="",
                description="Target in the first frame, [x, y, width, height] in pixels.",
            ),
            flag("target_from_ground_truth", "Take the target from the source's ground truth."),
            flag("publish_clock", "Publish the recording's time on /clock, and track by it."),
            DeclareLaunchArgument(
                "image", default_value="image", description="Topic of the images."
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="Namespace of both nodes."
            ),
            flag("tracker", "Start a tracker as well.", default_value="true"),
            DeclareLaunchArgument("preset", default_value="", description="Preset of the tracker."),
            DeclareLaunchArgument(
                "params_file", default_value="", description="ROS parameter file of the tracker."
            ),
            DeclareLaunchArgument(
                "image_transport",
                default_value="",
                description="compressed for a bag of compressed images; else the tracker takes "
                "raw ones.",
            ),
            flag("large_images", "Use the Fast DDS profile for large images in both nodes."),
            OpaqueFunction(function=start_replay),
        ]
    )
