"""Every tunable of the tracker, put together from what each part declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.cues import CUES, Cue, FusionParameters, TemplateParameters, power_group
from pf_tracker_ros.filter import MotionParameters, ProposalParameters, ResamplingParameters
from pf_tracker_ros.parameters import Groups, chosen, declared, group
from pf_tracker_ros.tracking.redetection import RedetectionParameters
from pf_tracker_ros.tracking.track_parameters import TrackParameters


def _of_powers(names: tuple[str, ...]) -> Groups:
    """The power of a single cue is 1."""
    if len(names) < 2:
        return {}
    usual = {name: getattr(CUES[name], "usual_power", Cue.usual_power) for name in names}
    return {name: power_group(power) for name, power in usual.items()}


def _of_cues(names: tuple[str, ...]) -> Groups:
    return {name: CUES.parameters_of(name) for name in names}


def _of_search(method: str) -> Groups:
    if method != "search":
        return {}
    return {"fusion": FusionParameters, "redetection": RedetectionParameters}


@dataclass(frozen=True)
class TrackerParameters:
    """The tracker's tunables; a preset names its values over these defaults."""

    particles: int = declared(
        300,
        "Number of particles; more are steadier and cost more.",
        minimum=1,
        maximum=100_000,
    )
    working_size: int = declared(
        40,
        "Targets whose sqrt(width * height) is above this are looked at in an image reduced by a "
        "whole factor that brings it to this or below, which bounds the cost: a target of any size "
        "in an image of 1920 x 1080 costs at most about three times what one of 40 px does.",
        unit="px",
        minimum=8,
        maximum=4096,
        read_only=True,
    )
    follow_light: bool = declared(
        False,
        "Whether images of 8 bit that become brighter or darker as a whole, by an exposure that is "
        "set anew or a lamp, are shown to the cues in the brightness of those before.",
    )
    motion: MotionParameters = group(MotionParameters)
    proposal: ProposalParameters = group(ProposalParameters)
    resampling: ResamplingParameters = group(ResamplingParameters)
    cues: tuple[str, ...] = declared(
        ("color_histogram", "gradient_orientation"),
        "What a box is compared by; each brings parameters of its own. One that is added while a "
        "target is tracked learns it from the next trusted frame.",
        choices=CUES,
    )
    of_powers: dict[str, Any] = chosen("cues", _of_powers)
    of_cues: dict[str, Any] = chosen("cues", _of_cues)
    of_search: dict[str, Any] = chosen("proposal.method", _of_search)
    template: TemplateParameters = group(TemplateParameters)
    track: TrackParameters = group(TrackParameters)
