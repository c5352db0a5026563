"""A motion model that declares a shared parameter differently."""

from dataclasses import dataclass

from pf_tracker_ros.filter import MOTION_MODELS
from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class UnlikeOthersParameters:
    """Noise in another unit."""

    position_noise: float = declared(3.0, "Noise.", unit="px", minimum=0.0, maximum=9.0)


@MOTION_MODELS.register("unlike_others", UnlikeOthersParameters)
class UnlikeOthers:
    """Only a name, since its parameters make it unusable."""
