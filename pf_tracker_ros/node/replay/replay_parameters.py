"""The parameters of the replay publisher."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ReplayParameters:
    """Parameters of the source, its speed, the target and lockstep."""

    source: str = declared(
        "",
        "Recording to replay: a rosbag2 folder or .mcap file, a video file, a folder of images, or "
        "a sequence folder (groundtruth.txt or groundtruth_rect.txt, and frames).",
        read_only=True,
    )
    bag_topic: str = declared(
        "",
        "Image topic of the bag; empty for the only one.",
        read_only=True,
    )
    bag_ground_truth_topic: str = declared(
        "",
        "Topic of type geometry_msgs/PolygonStamped in the bag with the true boxes; empty for the "
        "only one whose name ends with ground_truth, if any.",
        read_only=True,
    )
    rate: float = declared(
        1.0,
        "Speed relative to the source's own time; without effect in lockstep.",
        minimum=0.01,
        maximum=1000.0,
    )
    frame_rate: float = declared(
        25.0,
        "Frame rate of sources without one of their own, such as folders of images; determines "
        "their stamps.",
        unit="Hz",
        minimum=0.01,
        maximum=10_000.0,
        read_only=True,
    )
    loop: bool = declared(
        False,
        "Start again at the end. With a bag, in lockstep and with publish_clock the stamps start "
        "again as well; otherwise they continue with the time of publication.",
    )
    stay_at_end: bool = declared(
        False,
        "Wait at the end, paused, instead of exiting.",
        read_only=True,
    )
    start_paused: bool = declared(
        False,
        "Wait for the service ~/pause before the first frame.",
        read_only=True,
    )
    target_box: tuple[float, ...] = declared(
        (),
        "Box (x, y, width, height) of the target in the first frame, sent to the tracker before "
        "the frame; empty for none.",
        unit="px",
        minimum=-100_000.0,
        maximum=100_000.0,
        lengths=(0, 4),
        read_only=True,
    )
    target_from_ground_truth: bool = declared(
        False,
        "Send the first box of the source's ground truth to the tracker as its target.",
        read_only=True,
    )
    target_topic: str = declared(
        "pf_tracker/target",
        "Topic of the tracker's target.",
        read_only=True,
    )
    lockstep: bool = declared(
        False,
        "Publish each frame only after the tracker's status for the last one: no frame is lost, "
        "runs are reproducible and as fast as the tracker.",
        read_only=True,
    )
    lockstep_status: str = declared(
        "pf_tracker/status",
        "Topic of the tracker's status that lockstep waits for.",
        read_only=True,
    )
    lockstep_rate: float = declared(
        0.0,
        "Maximum speed in lockstep, relative to the source's own time; 0 for unlimited.",
        minimum=0.0,
        maximum=1000.0,
    )
    lockstep_timeout: float = declared(
        1.0,
        "Time that lockstep waits for the tracker's status before publishing the frame again.",
        unit="s",
        minimum=0.01,
        maximum=3600.0,
    )
    publish_clock: bool = declared(
        False,
        "Publish the source's time on /clock with each frame, for nodes with use_sim_time.",
        read_only=True,
    )
    image_reliability: str = declared(
        "reliable",
        "Reliability of the image publisher; reliable reaches subscribers of both kinds.",
        choices=("reliable", "best_effort"),
        read_only=True,
    )
    frame_id: str = declared(
        "camera",
        "Frame id of the headers; messages of a bag keep theirs.",
        read_only=True,
    )
