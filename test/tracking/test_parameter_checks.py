"""Combinations of parameters that are refused."""

import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.parameters import ParameterError


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"motion.model": "affine"},
            r"'proposal.method' is 'search' with the motion model 'affine'; allowed: 'transition' "
            r"or 'kalman', or the motion model 'constant_velocity' or 'constant_velocity_and_size'",
        ),
        (
            {"cues": ("color_histogram", "hog")},
            r"'proposal.method' is 'search', but no cue in 'cues' can search "
            r"with a weight above 0; allowed: 'transition', or 'color_contrast' or "
            r"'correlation_response' or 'coarse_correlation_response' in 'cues'",
        ),
        (
            {"cues": ("color_histogram", "color_contrast"), "color_contrast.weight": 0.0},
            r"'proposal.method' is 'search', but no cue in 'cues' can search with a ",
        ),
    ],
)
def test_a_search_without_its_parts_is_refused(parameters, message):
    with pytest.raises(ParameterError, match=message):
        Tracker.from_preset("default", parameters=parameters)


def test_the_kalman_filter_needs_a_gaussian_motion_model():
    with pytest.raises(
        ParameterError,
        match=r"'proposal\.method' is 'kalman' with the motion model 'constant_velocity'; allowed: "
        r"'transition' or 'search', or the motion model 'affine' or 'second_order_autoregressive'",
    ):
        Tracker.from_preset("zhang_bo", parameters={"motion.model": "constant_velocity"})


@pytest.mark.parametrize("preset", ["default", "li2007"])
def test_an_empty_list_of_cues_is_refused(preset):
    with pytest.raises(ParameterError, match=r"'cues' is empty; .* at least one of .*\bhog\b"):
        Tracker.from_preset(preset, parameters={"cues": ()})
