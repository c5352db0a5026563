"""The parameters of the tracker node that are not tunables of the tracker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.parameters import declared, parts
from pf_tracker_ros.targets.built_in_detectors import DETECTORS
from pf_tracker_ros.tracking.parameters import TargetCountParameters
from pf_tracker_ros.tracking.presets import PRESETS


@dataclass(frozen=True)
class NodeParameters(TargetCountParameters):
    """Which tracker the node runs, on what, and how it takes its images."""

    preset: str = declared(
        "default",
        "Preset that gives all tunables of the tracker their values; those that are set by name "
        "with it or after it win. A change while a target is tracked learns the target again where "
        "it was last seen.",
        choices=tuple(PRESETS),
    )
    built_in_detector: str = declared(
        "none",
        "Detector of the node's own that starts and corrects targets: people is OpenCV's for "
        "people who are at least 100 px high, motion finds what moves before a camera that stands "
        "still.",
        choices=("none", *DETECTORS),
    )
    detector_parameters: dict[str, Any] = parts("built_in_detector", DETECTORS)
    built_in_detector_rate: float = declared(
        1.0,
        "Most frames in a second that the built-in detector looks at, beside the tracker and as "
        "fast as it can; motion is cheap enough for 5.",
        unit="Hz",
        minimum=0.01,
        maximum=100.0,
    )
    seed: int = declared(
        0,
        "Seeds all randomness: the same frames, target and seed give the same boxes. A change "
        "takes effect with the next target.",
        minimum=0,
        maximum=2**31 - 1,
    )
    autostart: bool = declared(
        True,
        "Configure and activate the node as it starts; without it the node waits for a lifecycle "
        "manager.",
        read_only=True,
    )
    realtime_priority: int = declared(
        0,
        "Real-time priority (SCHED_RR) of Fast DDS' threads in the process tracker, where the "
        "system permits it, so that images are read in time; 0 asks for none. Where frames are "
        "lost or late on a busy machine, 1, the lowest there is, is enough.",
        minimum=0,
        maximum=99,
    )
    target_box: tuple[float, ...] = declared(
        (),
        "Box (x, y, width, height) to track from the next frame on; empty waits for a target on "
        "the topics ~/target and ~/click.",
        unit="px",
        minimum=-100_000.0,
        maximum=100_000.0,
        lengths=(0, 4),
    )
    click_size: float = declared(
        48.0,
        "Side of the square around a point on ~/click that is tracked.",
        unit="px",
        minimum=1.0,
        maximum=100_000.0,
    )
    image_transport: str = declared(
        "raw",
        "How images come: raw on the topic image, or compressed (JPEG, PNG) on image/compressed.",
        choices=("raw", "compressed"),
    )
    image_reliability: str = declared(
        "auto",
        "Reliability asked of the image publishers: auto is reliable where all of them offer it, "
        "and takes the newest frame; best_effort may lose frames on the way; reliable keeps up to "
        "ten frames waiting, and gets none from a best-effort publisher.",
        choices=("auto", "best_effort", "reliable"),
    )
    max_image_pixels: int = declared(
        2**24,
        "Most pixels of a compressed image; one that announces more is refused before memory is "
        "taken for it.",
        unit="px",
        minimum=1,
        maximum=2**30,
    )
    frame_buffer_length: int = declared(
        120,
        "Most frames that are kept, so that a target can be started on the one that it was drawn "
        "on; 0 keeps none.",
        minimum=0,
        maximum=10_000,
    )
    frame_buffer_megabytes: float = declared(
        64.0,
        "Most memory for the images of these frames. Where those of 2.2 s need more, the newest "
        "are kept in full, and of the others ten a second, halved in size until they fit. An image "
        "that needs more by itself is not kept. Beside them each frame needs about 0.1 MB for each "
        "target.",
        unit="MB",
        minimum=0.0,
        maximum=100_000.0,
    )
    time_jump: str = declared(
        "keep",
        "What a jump of the stamps back in time does, as when a bag begins again: keep goes on "
        "with the target, restart starts again on the box that it was first drawn with, wait "
        "forgets it.",
        choices=("keep", "restart", "wait"),
    )
    time_jump_threshold: float = declared(
        1.0,
        "A frame that is older than the last one by no more than this came late and is dropped; "
        "by more, time has jumped back.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    image_timeout: float = declared(
        2.0,
        "Without an image for so long, /diagnostics warns.",
        unit="s",
        minimum=0.1,
        maximum=3600.0,
    )
