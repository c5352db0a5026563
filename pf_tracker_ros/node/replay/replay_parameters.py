"""The parameters of the replay publisher."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ReplayParameters:
    """What is replayed, how fast, and for whom it waits."""

    source: str = declared(
        "",
        "What to replay: a rosbag2 folder or .mcap file, a video file, a folder of images, or a "
        "sequence folder (groundtruth.txt or groundtruth_rect.txt, and frames).",
        read_only=True,
    )
    bag_topic: str = declared(
        "",
        "Image topic of the bag; empty takes the only one that there is.",
        read_only=True,
    )
    bag_ground_truth_topic: str = declared(
        "",
        "Topic of type geometry_msgs/PolygonStamped in the bag with the true boxes; empty takes "
        "the only one whose name ends with ground_truth, if there is one.",
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
        "Frames a second of sources that do not know theirs, such as folders of images; it "
        "decides their stamps.",
        unit="Hz",
        minimum=0.01,
        maximum=10_000.0,
        read_only=True,
    )
    loop: bool = declared(
        False,
        "Begin again at the end. The stamps begin again too with a bag, in lockstep and with "
        "publish_clock; else they go on with the time at which frames are played.",
    )
    stay_at_end: bool = declared(
        False,
        "Wait at the end, paused, in place of ending.",
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
        "it; empty sends none.",
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
        "Where the tracker takes its target.",
        read_only=True,
    )
    lockstep: bool = declared(
        False,
        "Publish the next frame only after the tracker's status for the last one: no frame is "
        "lost, each run is the same, and it goes as fast as the tracker.",
        read_only=True,
    )
    lockstep_status: str = declared(
        "pf_tracker/status",
        "Topic of the tracker's status that lockstep waits for.",
        read_only=True,
    )
    lockstep_rate: float = declared(
        0.0,
        "Highest speed in lockstep, relative to the source's own time; 0 goes as fast as the "
        "tracker.",
        minimum=0.0,
        maximum=1000.0,
    )
    lockstep_timeout: float = declared(
        1.0,
        "How long lockstep waits for the tracker's status before it publishes the frame again.",
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
        "Frame of the headers; messages of a bag keep theirs.",
        read_only=True,
    )
