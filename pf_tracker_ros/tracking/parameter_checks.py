"""Parameters that are allowed one by one, but not together."""

from __future__ import annotations

from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.filter.motion import models_with
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.parameters import TrackerParameters

# Proposal method to the method that a motion model needs for it.
_NEEDED = {"kalman": "foresight", "search": "center_prior"}


def check_cues(parameters: TrackerParameters) -> None:
    """Refuse to compare boxes by nothing.

    Raises:
        ParameterError: Says what to choose.
    """
    if not parameters.cues:
        raise ParameterError(
            f"parameter 'cues' is empty; allowed: at least one of {', '.join(CUES)}"
        )


def check_proposal(parameters: TrackerParameters, fusion: CueFusion) -> None:
    """Refuse proposals that the motion model or the cues can't make.

    Raises:
        ParameterError: Says which parameter to change.
    """
    method, model = parameters.proposal.method, parameters.motion.model
    if method in _NEEDED and model not in models_with(_NEEDED[method]):
        allowed = " or ".join(f"'{name}'" for name in models_with(_NEEDED[method]))
        raise ParameterError(
            f"parameter 'proposal.method' is '{method}' with the motion model '{model}'; allowed: "
            f"'transition', or the motion model {allowed}"
        )
    if method == "search" and not fusion.can_search:
        searchable = " or ".join(
            f"'{name}'" for name, cue in CUES.items() if hasattr(cue, "strength")
        )
        raise ParameterError(
            "parameter 'proposal.method' is 'search', but no cue in 'cues' with a power above 0 "
            f"can search; allowed: 'transition' or 'kalman', or {searchable} in 'cues'"
        )
