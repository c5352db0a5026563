"""The parameters of several targets, and the presets' values for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from pf_tracker_ros.parameters import build, declared, flatten, group
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.track_parameters import TrackParameters


@dataclass(frozen=True)
class TargetsParameters:
    """How many targets there may be."""

    most: int = declared(
        32,
        "Most targets at a time; detections start no more, each costs about as much as one.",
        minimum=1,
        maximum=1000,
    )


@dataclass(frozen=True)
class DetectorParameters:
    """What is known of the detector that starts and corrects targets."""

    labels: tuple[str, ...] = declared(
        (),
        "Labels of the detections that count, as the detector writes them, such as person; empty "
        "takes all.",
    )
    score_above: float = declared(
        0.3,
        "Detections of a lower score are left out.",
        minimum=0.0,
        maximum=1.0,
    )
    recall: float = declared(
        0.8,
        "Share of the visible targets that the detector finds in a frame; with a higher one, a "
        "target that it does not find ends sooner.",
        minimum=0.05,
        maximum=0.99,
    )


@dataclass(frozen=True)
class SeveralTrackParameters(TrackParameters):
    """As of a single target, and for how long one that has ended is remembered."""

    remember: float = declared(
        10.0,
        "A target that has ended, and that a detector sees again within this time, is the same one "
        "if it looks alike; 0 remembers none.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )


@dataclass(frozen=True)
class SeveralTargetsParameters(TrackerParameters):
    """The tunables of several targets, but for how many there may be."""

    track: SeveralTrackParameters = group(SeveralTrackParameters)
    detector: DetectorParameters = group(DetectorParameters)


@dataclass(frozen=True)
class MultiTrackerParameters(SeveralTargetsParameters):
    """The tunables of several targets: those of each, and those of all together."""

    targets: TargetsParameters = group(TargetsParameters)


# What several targets ask of a preset: less work for each, and a narrower look around, since what
# looks like the target is often beside it. The foreground keeps them off what they pass.
_FOR_SEVERAL: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "default": MappingProxyType(
            {
                "particles": 100,
                "proposal.window": 2.0,
                "cues": ("color_contrast", "coarse_correlation_response", "foreground"),
                "foreground.sharpness": 60.0,
            }
        ),
    }
)


def multi_preset_parameters(name: str) -> dict[str, Any]:
    """The value of every parameter in a preset, for several targets.

    Args:
        name: A key of `PRESETS`.

    Returns:
        Full parameter name to value, in order of declaration.

    Raises:
        ParameterError: No preset has this name; the message lists those there are.
    """
    values = {**preset_parameters(name), **_FOR_SEVERAL.get(name, {})}
    return flatten(build(MultiTrackerParameters, values))
