"""Parameters that are allowed one by one, but not together."""

from __future__ import annotations

from pf_tracker_ros.cues import CueFusion
from pf_tracker_ros.filter import MODELS_WITH_CENTER_PRIOR, MODELS_WITH_FORESIGHT
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.parameters import TrackerParameters


def check_proposal(parameters: TrackerParameters, fusion: CueFusion) -> None:
    """Refuse proposals that the motion model or the cues that are on can't make.

    Raises:
        ParameterError: Says which parameter to change.
    """
    proposal, model = parameters.proposal, parameters.motion.model
    for name, share, models in (
        ("kalman_share", proposal.kalman_share, MODELS_WITH_FORESIGHT),
        ("search_share", proposal.search_share, MODELS_WITH_CENTER_PRIOR),
    ):
        if share > 0.0 and model not in models:
            allowed = " or ".join(f"'{name}'" for name in models)
            raise ParameterError(
                f"parameter 'proposal.{name}' is {share} with the motion model '{model}'; "
                f"allowed: 0, or the motion model {allowed}"
            )
    if proposal.search_share > 0.0 and not fusion.can_search:
        raise ParameterError(
            f"parameter 'proposal.search_share' is {proposal.search_share}, but no cue that is on "
            "can search; allowed: 0, or 'foreground_probability.power' or "
            "'correlation_response.power' above 0"
        )
