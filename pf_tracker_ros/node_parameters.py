"""The parameters of the tracker node other than the tracker's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.parameters import declared, parts
from pf_tracker_ros.targets.built_in_detectors import DETECTORS
from pf_tracker_ros.tracking.frame_clock import DEFAULT_FROZEN_AFTER
from pf_tracker_ros.tracking.parameters import TargetCountParameters
from pf_tracker_ros.tracking.presets import PRESETS


@dataclass(frozen=True)
class NodeParameters(TargetCountParameters):
    """Preset, detector, images and time of the node."""

    preset: str = declared(
        "default",
        "Preset with a value for every parameter of the tracker; parameters set by name with it or "
        "after it win. After a change, targets are relearned where they were last seen.",
        choices=tuple(PRESETS),
    )
    built_in_detector: str = declared(
        "none",
        "Built-in detector that starts and corrects targets: people is OpenCV's pedestrian "
        "detector for heights from 100 px, motion detects moving objects before a still camera.",
        choices=("none", *DETECTORS),
    )
    detector_parameters: dict[str, Any] = parts("built_in_detector", DETECTORS)
    built_in_detector_rate: float = declared(
        1.0,
        "Maximum rate of the built-in detector, which runs in parallel to the tracker. motion is "
        "cheap enough for 5 Hz.",
        unit="Hz",
        minimum=0.01,
        maximum=100.0,
    )
    seed: int = declared(
        0,
        "Seed of all random numbers: the same frames, target and seed give the same boxes. A "
        "change takes effect with the next target.",
        minimum=0,
        maximum=2**31 - 1,
    )
    autostart: bool = declared(
        True,
        "Configure and activate the node at start-up; false waits for a lifecycle manager.",
        read_only=True,
    )
    realtime_priority: int = declared(
        0,
        "Real-time priority (SCHED_RR) of Fast DDS' threads in the process tracker, if the system "
        "permits it, to read images in time; 0 for none. 1, the lowest, is enough against lost or "
        "late frames on a busy machine.",
        minimum=0,
        maximum=99,
    )
    target_box: tuple[float, ...] = declared(
        (),
        "Box (x, y, width, height) to track from the next frame on; empty waits for a target on "
        "~/target or ~/click.",
        unit="px",
        minimum=-100_000.0,
        maximum=100_000.0,
        lengths=(0, 4),
    )
    click_size: float = declared(
        48.0,
        "Side of the square box around a point of ~/click.",
        unit="px",
        minimum=1.0,
        maximum=100_000.0,
    )
    image_transport: str = declared(
        "raw",
        "Transport of the images: raw on the topic image, or compressed (JPEG, PNG) on "
        "image/compressed.",
        choices=("raw", "compressed"),
    )
    image_reliability: str = declared(
        "auto",
        "Requested reliability of the image publishers: auto is reliable if all of them offer it, "
        "and processes the newest frame; best_effort may lose frames in transport; reliable queues "
        "up to ten frames, and receives none from a best-effort publisher.",
        choices=("auto", "best_effort", "reliable"),
    )
    max_image_pixels: int = declared(
        2**24,
        "Maximum number of pixels of a compressed image; a larger one is refused before its "
        "memory is allocated.",
        unit="px",
        minimum=1,
        maximum=2**30,
    )
    frame_buffer_length: int = declared(
        120,
        "Maximum number of buffered frames. A target starts on the frame on which it was drawn, "
        "and late detections are applied, if that frame is buffered; 0 buffers none.",
        minimum=0,
        maximum=10_000,
    )
    frame_buffer_megabytes: float = declared(
        64.0,
        "Maximum memory of the buffered images. If those of 2.2 s need more, the newest are kept "
        "in full, and of the others ten a second, halved in size until they fit. A single larger "
        "image is not kept. In addition, each frame needs about 0.1 MB for each target.",
        unit="MB",
        minimum=0.0,
        maximum=100_000.0,
    )
    time_jump: str = declared(
        "keep",
        "Reaction to a jump back in time, as when a bag starts again: keep keeps the targets, "
        "restart restarts manual targets on their first box, wait stops all targets.",
        choices=("keep", "restart", "wait"),
    )
    time_jump_threshold: float = declared(
        1.0,
        "A frame older than the last one by at most this is late and dropped; an older one is a "
        "jump back in time.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    frozen_after: float = declared(
        DEFAULT_FROZEN_AFTER,
        "Images that are equal to the bit for longer than this, by their stamps, are skipped as "
        "frozen; 0 for never, as for generated scenes without noise.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    image_timeout: float = declared(
        2.0,
        "Time without an image before a warning on /diagnostics.",
        unit="s",
        minimum=0.1,
        maximum=3600.0,
    )
