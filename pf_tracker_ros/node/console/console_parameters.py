"""The parameters of the console."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ConsoleParameters:
    """Where the page is served, which tracker it is about, and what it plays."""

    source: str = declared(
        "",
        "Recording to play to the tracker from the page: a rosbag2 folder or .mcap file, a video, "
        "a folder of images, or a sequence folder. Empty takes the images that there are.",
        read_only=True,
    )
    bag_topic: str = declared(
        "",
        "Image topic of the recording, if that is a bag; empty takes the only one that there is.",
        read_only=True,
    )
    host: str = declared(
        "127.0.0.1",
        "Address or name to serve the page on. On any other than this machine's loopback, browsers "
        "have to bring the access token of the link that is written on the terminal.",
        read_only=True,
    )
    port: int = declared(
        8642,
        "Port to serve the page on; 0 takes a free one.",
        minimum=0,
        maximum=65_535,
        read_only=True,
    )
    tracker: str = declared(
        "pf_tracker",
        "Name of the tracker's node, in the console's namespace unless it begins with a slash.",
        read_only=True,
    )
    realtime_priority: int = declared(
        0,
        "Real-time priority (SCHED_RR) of Fast DDS' threads in the process console, where the "
        "system permits it, so that a camera that publishes reliably waits less for this reader; 0 "
        "asks for none, 1 is the lowest there is. With a Fast DDS profile no camera waits, and "
        "there is none.",
        minimum=0,
        maximum=99,
        read_only=True,
    )
