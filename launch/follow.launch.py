"""Start tracker and localizer on a camera: where the selected target is, in meters.

For example, a person picked by the built-in detector, before a camera 1.2 m above the ground::

    ros2 launch pf_tracker_ros follow.launch.py image:=/camera/image_raw camera_height:=1.2 \
        built_in_detector:=people

Or a box drawn by hand, with depth and a robot that moves::

    ros2 launch pf_tracker_ros follow.launch.py image:=/camera/color/image_raw \
        depth:=/camera/aligned_depth_to_color/image_raw odom:=/odom camera_height:=0.6

A robot follows the topic localizer/pose.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from pf_tracker_ros.launching import (
    TRACKER_ARGUMENTS,
    LaunchArguments,
    argument,
    detector_overrides,
    localizer_node,
    shared_arguments,
    tracker_nodes,
)


def start_nodes(context: LaunchContext) -> list[Node]:
    """Tracker and localizer with the given arguments, and a console on request."""
    given = LaunchArguments(context)
    parameters = detector_overrides(given)
    if box := given.box("target_box"):
        parameters["target_box"] = box
    topics = {"image": given.text("image"), "detections": given.text("detections")}
    return [*tracker_nodes(given, parameters, topics), localizer_node(given)]


def generate_launch_description() -> LaunchDescription:
    """Arguments and the nodes; an empty argument keeps the node's default."""
    return LaunchDescription(
        [
            *shared_arguments("image"),
            argument(
                "camera_info", "Topic of the calibration; empty for camera_info beside the images."
            ),
            argument("depth", "Topic of the depth images, registered to the images.", "depth"),
            argument("odom", "Topic of the odometry of a robot that moves.", "odom"),
            argument("imu", "Topic of an accelerometer, for the camera's tilt.", "imu"),
            argument("method", "auto, depth, ground or height."),
            argument("fixed_frame", "Frame of the positions; default odom."),
            argument("camera_height", "Height of the camera above the ground, meters."),
            argument("camera_pitch", "Angle by which the camera looks down, radians."),
            argument("camera_roll", "Angle by which its right side is lowered, radians."),
            argument("rectified", "The images are rectified, as image_rect.", "false"),
            argument("target_height", "Mean height of the targets, meters; default 1.75."),
            argument("target_height_sd", "Standard deviation of their heights, meters."),
            argument("depth_transport", "raw, compressed or compressedDepth."),
            argument("depth_tolerance", "Largest difference of the stamps of image and depth, s."),
            argument("min_confidence", "Confidence of the tracker from which there is a pose."),
            argument("coast", "Longest time for which the pose is predicted, seconds."),
            argument("hold", "Longest time without a pose after a doubt, seconds."),
            argument("max_targets", "Maximum number of targets; with 1 it is the selected one."),
            *shared_arguments("target_box", "detections", "labels", "score_above"),
            *shared_arguments("built_in_detector", "built_in_detector_rate"),
            *shared_arguments(*TRACKER_ARGUMENTS),
            OpaqueFunction(function=start_nodes),
        ]
    )
