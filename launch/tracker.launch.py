"""Start the tracker on a camera's images.

For example, for a target drawn as a box in the first frame::

    ros2 launch pf_tracker_ros tracker.launch.py image:=/camera/image_raw \
        target_box:="[293, 97, 115, 82]"
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "pf_tracker_ros"
BOOLEAN = ["true", "false"]
TEXTS = ("preset", "image_reliability", "image_transport")


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker node with what was given; the rest is for its own defaults."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    parameters = {"use_sim_time": given("use_sim_time") == "true"}
    for name in TEXTS:
        if given(name):
            parameters[name] = ParameterValue(given(name), value_type=str)
    if given("autostart") == "false":
        parameters["autostart"] = False
    if given("target_box"):
        parameters["target_box"] = box(given("target_box"))
    environment = {}
    if given("large_images") == "true":
        profile = Path(get_package_share_directory(PACKAGE)) / "config/fastdds_large_images.xml"
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profile)
    files = [given("params_file")] if given("params_file") else []
    return [
        Node(
            package=PACKAGE,
            executable="tracker",
            name="pf_tracker",
            namespace=given("namespace") or None,
            # What comes later wins, so an argument wins over the file.
            parameters=[*files, parameters],
            remappings=[("image", given("image"))],
            additional_env=environment,
            output="screen",
            emulate_tty=True,
        )
    ]


def box(text: str) -> list[float] | ParameterValue:
    """Four numbers with or without brackets; any other text is left for the node to refuse."""
    try:
        return [float(part) for part in text.strip("[] ").split(",")]
    except ValueError:
        return ParameterValue(text, value_type=str)


def generate_launch_description() -> LaunchDescription:
    """Arguments and the tracker; an empty argument leaves the node's own default in force."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "image", default_value="image", description="Topic of the images."
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node, one for each of several cameras.",
            ),
            DeclareLaunchArgument(
                "preset", default_value="", description="Preset, such as default or li2007."
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="ROS parameter file, such as a copy of one in config/.",
            ),
            DeclareLaunchArgument(
                "target_box",
                default_value="",
                description="Box to track from the first frame on, [x, y, width, height] in "
                "pixels; without it the tracker waits for a target on ~/target.",
            ),
            DeclareLaunchArgument(
                "image_reliability",
                default_value="",
                description="best_effort (newest frame wins) or reliable (every frame).",
            ),
            DeclareLaunchArgument(
                "image_transport",
                default_value="",
                description="raw, or compressed for JPEG and PNG on <image>/compressed.",
            ),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                choices=BOOLEAN,
                description="Start tracking at once; false leaves it to a lifecycle manager.",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                choices=BOOLEAN,
                description="Take the time from /clock.",
            ),
            DeclareLaunchArgument(
                "large_images",
                default_value="false",
                choices=BOOLEAN,
                description="Use the Fast DDS profile for large images; the publisher of the "
                "images needs it too.",
            ),
            OpaqueFunction(function=start_tracker),
        ]
    )
