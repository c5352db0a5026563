"""The parameters of the console."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ConsoleParameters:
    """Address of the page, name of the tracker, and recording to play."""

    source: str = declared(
        "",
        "Recording to play to the tracker from the page: a rosbag2 folder or .mcap file, a video, "
        "a folder of images, or a sequence folder. If empty, nothing is played.",
        read_only=True,
    )
    recordings: tuple[str, ...] = declared(
        (),
        "Further recordings to choose from on the page, as `source` each.",
        read_only=True,
    )
    tour: str = declared(
        "",
        "YAML file with recordings to choose from on the page, and what to try with each of them. "
        "If `source` is empty, its first recording is played first.",
        read_only=True,
    )
    bag_topic: str = declared(
        "",
        "Image topic of the recorded bags. Empty selects the only one.",
        read_only=True,
    )
    host: str = declared(
        "127.0.0.1",
        "Address or name to serve the page on. Other than on the loopback, browsers need the "
        "access token in the link that the console logs.",
        read_only=True,
    )
    port: int = declared(
        8642,
        "Port to serve the page on. 0 selects a free one.",
        minimum=0,
        maximum=65_535,
        read_only=True,
    )
    tracker: str = declared(
        "pf_tracker",
        "Name of the tracker's node, relative to the console's namespace unless it is absolute.",
        read_only=True,
    )
    realtime_priority: int = declared(
        0,
        "Real-time priority (SCHED_RR) of the Fast DDS threads of the console, where the system "
        "permits it: a reliable camera then waits less for this reader. 1 is the lowest, 0 "
        "requests none. Without effect with a Fast DDS profile, where no camera waits.",
        minimum=0,
        maximum=99,
        read_only=True,
    )
