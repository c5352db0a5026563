"""Combinations of parameters that are refused."""

import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.parameters import ParameterError


@pytest.mark.parametrize(
    ("preset", "parameters", "message"),
    [
        (
            "default",
            {"motion.model": "affine"},
            r"'proposal.method' is 'search' with the motion model 'affine'; allowed: 'transition' "
            r"or 'kalman', or the motion model 'constant_velocity' or 'constant_velocity_and_size'",
        ),
        (
            "default",
            {"cues": ("color_histogram", "hog")},
            r"'proposal.method' is 'search', but no cue in 'cues' can search "
            r"with a weight above 0; allowed: 'transition', or 'color_contrast' or "
            r"'correlation_response' or 'coarse_correlation_response' in 'cues'",
        ),
        (
            "default",
            {"cues": ("color_histogram", "color_contrast"), "color_contrast.weight": 0.0},
            r"'proposal.method' is 'search', but no cue in 'cues' can search with a ",
        ),
        (
            "zhang_bo",
            {"motion.model": "constant_velocity"},
            r"'proposal\.method' is 'kalman' with the motion model 'constant_velocity'; allowed: "
            r"'transition' or 'search', or the motion model 'affine' or "
            r"'second_order_autoregressive'",
        ),
        ("default", {"cues": ()}, r"'cues' is empty; .* at least one of .*\bhog\b"),
        ("li2007", {"cues": ()}, r"'cues' is empty; .* at least one of .*\bhog\b"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(preset, parameters, message):
    with pytest.raises(ParameterError, match=message):
        Tracker.from_preset(preset, parameters=parameters)
