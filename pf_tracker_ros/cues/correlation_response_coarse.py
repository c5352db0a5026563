"""Coarse correlation response cue: the correlation response in less detail, for many targets."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.cues.correlation_response import (
    CorrelationResponse,
    CorrelationResponseParameters,
)
from pf_tracker_ros.cues.cue import CUES
from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class CoarseCorrelationResponseParameters(CorrelationResponseParameters):
    """The coarse correlation response cue."""

    window: float = declared(
        2.5,
        "Side of the square window around the target that the filter is trained in; a larger one "
        "sees faster targets, and more of what is not the target.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )


@CUES.register("coarse_correlation_response", CoarseCorrelationResponseParameters)
class CoarseCorrelationResponse(CorrelationResponse):
    """The correlation response in fewer, larger cells, and in sizes further apart.

    Args:
        parameters: Features, window and sharpness.
        cells: Along each side of the window, even.
        settling_frames: As for `CorrelationResponse`.
    """

    def __init__(
        self,
        parameters: CoarseCorrelationResponseParameters,
        *,
        cells: int = 24,
        settling_frames: int = 1,
    ) -> None:
        super().__init__(parameters, cells=cells, size_span=1.1, settling_frames=settling_frames)
