"""Checks of combinations of parameters."""

from __future__ import annotations

from pf_tracker_ros.cues import CUES, CueFusion
from pf_tracker_ros.filter.motion import MOTION_MODELS, models_with
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.parameters import TrackerParameters

# Proposal method to the method that it requires of the motion model.
_REQUIRED = {"kalman": "kalman_filter", "search": "center_prior"}


def check_proposal(parameters: TrackerParameters, fusion: CueFusion) -> None:
    """Check the motion model, and that it and the cues support the proposal.

    Raises:
        ParameterError: They do not; names the allowed values.
    """
    method, model = parameters.proposal.method, parameters.motion.model
    # Report an unusable model now, not when the first target needs it.
    MOTION_MODELS.check(model)
    supported = [one for one, required in _REQUIRED.items() if model in models_with(required)]
    methods = " or ".join(f"'{one}'" for one in ("transition", *supported) if one != method)
    if method in _REQUIRED and method not in supported:
        models = " or ".join(f"'{name}'" for name in models_with(_REQUIRED[method]))
        raise ParameterError(
            f"parameter 'proposal.method' is '{method}' with the motion model '{model}'; allowed: "
            f"{methods}, or the motion model {models}"
        )
    if method == "search" and not fusion.can_search:
        searchable = " or ".join(
            f"'{name}'" for name, cue in CUES.items() if hasattr(cue, "response")
        )
        raise ParameterError(
            "parameter 'proposal.method' is 'search', but no cue in 'cues' can search with a "
            f"weight above 0; allowed: {methods}, or {searchable} in 'cues'"
        )
    if method == "search" and fusion.proposes and model not in models_with("with_boxes"):
        models = " or ".join(f"'{name}'" for name in models_with("with_boxes"))
        raise ParameterError(
            f"parameter 'motion.model' is '{model}' with a cue that proposes boxes; allowed: "
            f"{models}"
        )
