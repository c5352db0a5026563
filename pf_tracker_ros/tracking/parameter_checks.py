"""Parameters that are allowed one by one, but not together."""

from __future__ import annotations

from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.filter.motion import MOTION_MODELS, models_with
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.parameters import TrackerParameters

# Proposal method to the method that a motion model needs for it.
_NEEDED = {"kalman": "kalman_filter", "search": "center_prior"}


def check_proposal(parameters: TrackerParameters, fusion: CueFusion) -> None:
    """Refuse a motion model that cannot be used, and proposals that it or the cues can't make.

    Raises:
        ParameterError: Says which parameter to change.
    """
    method, model = parameters.proposal.method, parameters.motion.model
    # It is made for each target anew, which is too late to tell.
    MOTION_MODELS.check(model)
    suiting = [one for one, needed in _NEEDED.items() if model in models_with(needed)]
    with_model = " or ".join(f"'{one}'" for one in ("transition", *suiting) if one != method)
    if method in _NEEDED and method not in suiting:
        allowed = " or ".join(f"'{name}'" for name in models_with(_NEEDED[method]))
        raise ParameterError(
            f"parameter 'proposal.method' is '{method}' with the motion model '{model}'; allowed: "
            f"{with_model}, or the motion model {allowed}"
        )
    if method == "search" and not fusion.can_search:
        searchable = " or ".join(
            f"'{name}'" for name, cue in CUES.items() if hasattr(cue, "response")
        )
        raise ParameterError(
            "parameter 'proposal.method' is 'search', but no cue in 'cues' can search with a weight "
            f"above 0; allowed: {with_model}, or {searchable} in 'cues'"
        )
