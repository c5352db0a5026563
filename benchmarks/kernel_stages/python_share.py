"""Share of Python's overhead in an update of `default`: calls and array objects.

The same sequence of calls is made with next to nothing in the arrays: 2 particles, a window of 4
cells instead of 40, the smallest search with a rival, and an image of 64 x 48. What that takes is
what calling costs, in Python and at NumPy's and OpenCV's doors, whatever is in the arrays. How many
functions are called in both shows whether the sequence is the same.
"""

from __future__ import annotations

import sys
from collections import Counter
from types import FrameType
from typing import Any, NamedTuple

from kernel_stages.setting import street
from kernel_stages.timing import Timed, by_turns
from pf_tracker_ros import Tracker
from pf_tracker_ros.cues.correlation_response import (
    CorrelationResponse,
    CorrelationResponseParameters,
)
from pf_tracker_ros.cues.cue import CUES

_FRAMES = 60
# Updates whose calls are counted: the filter is trained in one of three.
_COUNTED = 6
_USUAL = {"track.wrong_box_cost": 0.0}
_LEAST = {
    "particles": 2,
    "cues": ("color_contrast", "smallest_correlation_response"),
    "proposal.window": 2.1,
}


@CUES.register("smallest_correlation_response", CorrelationResponseParameters)
class SmallestCorrelationResponse(CorrelationResponse):
    """The correlation response with the fewest cells.

    Args:
        parameters: As for `CorrelationResponse`.
    """

    def __init__(self, parameters: CorrelationResponseParameters) -> None:
        super().__init__(parameters, cells=4)
        # As windows of the usual number of cells are.
        self._windows_at_once = 1


class PythonShare(NamedTuple):
    """What was found.

    Attributes:
        update: Milliseconds of an update.
        overhead: Milliseconds of the same calls with next to nothing to do.
        calls: Functions that an update calls, Python's and those in C that are called by name.
        least_calls: The same with next to nothing to do.
    """

    update: float
    overhead: float
    calls: float
    least_calls: float


def measure_python_share(turns: int) -> PythonShare:
    """See this module."""
    usual, least = _started(768, 576, 40, _USUAL), _started(64, 48, 8, _USUAL | _LEAST)
    calls = [_calls(one) / _COUNTED for one in (usual, least)]
    timed = [Timed(lambda _: usual()), Timed(lambda _: least())]
    return PythonShare(*by_turns(timed, turns), *calls)


def _started(width: int, height: int, side: int, parameters: dict[str, Any]) -> Any:
    """What follows a target one frame further, past the frames in which it is learned anew."""
    image = street(width, height)
    tracker = Tracker.from_preset("default", seed=0, parameters=parameters)
    tracker.start(image, ((width - side) / 2, (height - side) / 2, side, side))
    for _ in range(_FRAMES):
        tracker.update(image)
    return lambda: tracker.update(image)


def _calls(update: Any) -> int:
    counted: Counter[str] = Counter()

    def count(frame: FrameType, event: str, argument: object) -> None:
        counted[event] += 1

    sys.setprofile(count)
    for _ in range(_COUNTED):
        update()
    sys.setprofile(None)
    return counted["call"] + counted["c_call"]
