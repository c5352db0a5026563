"""Calibration: similarity and log odds from the responses of a filter."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.cues.correlation_response import (
    CorrelationResponse,
    CorrelationResponseParameters,
    DeferredObservation,
)
from pf_tracker_ros.cues.features import Calibration
from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors
from pf_tracker_ros.frames import Frame, Region

CALIBRATION = Calibration(
    even_clutter=0.1,
    even_level=0.5,
    exponent=2.0,
    odds_slope=1.5,
    even_peak_to_sidelobe=6.0,
)


def test_at_the_even_values_each_factor_of_the_similarity_is_a_half():
    assert CALIBRATION.similarity(0.5, 0.05, 1.0) == pytest.approx(0.25)
    # Twice the even ratio: 4 / (1 + 4); the level's factor is a half.
    assert CALIBRATION.similarity(0.5, 0.025, 1.0) == pytest.approx(0.8 * 0.5)
    assert CALIBRATION.similarity(1.0, 0.1, 1.0) == pytest.approx(0.5 * 0.8)


def test_log_odds_are_0_at_the_even_values_and_linear_in_logarithms():
    assert CALIBRATION.log_odds(6.0) == {"response": 0.0}
    assert CALIBRATION.log_odds(6.0 / math.e) == pytest.approx({"response": -1.5})


def test_the_cue_uses_the_calibration_of_its_features(monkeypatch):
    image = np.random.default_rng(0).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    box = np.array([60.0, 40.0, 30.0, 30.0])

    def results(**changes):
        calibration = replace(GradientsAndColors.calibration, **changes)
        monkeypatch.setattr(GradientsAndColors, "calibration", calibration)
        cue = CorrelationResponse(CorrelationResponseParameters())
        region = Region(Frame(image), box[None])
        template, observation = cue.learn(region, box), DeferredObservation(region, box)
        return cue.match(observation, template).similarity, cue.log_odds(observation, template)

    (similarity, odds), (another, doubled) = (
        results(),
        results(odds_slope=2.0 * GradientsAndColors.calibration.odds_slope, even_level=2.0),
    )
    assert doubled["response"] == pytest.approx(2.0 * odds["response"])
    assert 0.0 < another < similarity <= 1.0
