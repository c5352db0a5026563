"""Calibration of the reported confidence."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.assessment import ConfidenceCalibration

PARAMETER = "track.confidence_calibration"


def test_the_log_odds_are_scaled_and_shifted():
    """Odds of 4 to the power of one half are 2, and times e they are 2 e."""
    odds = 2 * np.e
    calibrated = ConfidenceCalibration(0.5, 1.0).apply([0.8, 0.5])
    assert calibrated == pytest.approx([odds / (1 + odds), np.e / (1 + np.e)])


def test_the_order_stays_within_0_to_1():
    confidence = np.linspace(0.0, 1.0, 1001)
    assert ConfidenceCalibration().apply(confidence).tolist() == confidence.tolist()
    for values in ((0.3, 2.0), (3.0, -1.0), (20.0, 20.0)):
        calibrated = ConfidenceCalibration(*values).apply(confidence)
        assert (np.diff(calibrated) >= 0.0).all()
        assert 0.0 <= calibrated[0] < calibrated[-1] <= 1.0


@pytest.mark.parametrize("preset", ["default", "li2007"])
def test_boxes_and_states_stay(preset, moving_square):
    """The target is hidden in the middle, so that all states and the redetection take part."""
    images = [*moving_square.images[:6], *[np.full_like(moving_square.images[0], 90)] * 4]
    images += [*moving_square.images[6:12]]

    def estimates(values):
        tracker = Tracker.from_preset(preset, seed=0, parameters={PARAMETER: values})
        tracker.start(images[0], moving_square.boxes[0])
        return [tracker.update(image, 0.3) for image in images[1:]]

    plain, calibrated = estimates((1.0, 0.0)), estimates((0.5, 1.0))
    assert len({one.state for one in plain}) > 1
    assert [(one.box, one.state) for one in plain] == [(one.box, one.state) for one in calibrated]
    expected = ConfidenceCalibration(0.5, 1.0).apply([one.confidence for one in plain])
    assert [one.confidence for one in calibrated] == expected.tolist()


@pytest.mark.parametrize(
    ("values", "allowed"),
    [
        ((0.0, 1.0), "has the scale 0; allowed: 0.01 to 20"),
        ((-1.0, 1.0), "has the scale -1; allowed: 0.01 to 20"),
        ((1.0,), "2 numbers, each -20 to 20"),
        ((1.0, float("nan")), "2 numbers, each -20 to 20"),
        (1.0, "list of floats"),
    ],
)
def test_a_wrong_calibration_is_refused(values, allowed):
    with pytest.raises(ParameterError, match=f"'{PARAMETER}'.*{allowed}"):
        Tracker.from_preset("default", parameters={PARAMETER: values})
