"""Fusion: a product of powers for any number of cues."""

import numpy as np
import pytest

from pf_tracker_ros.cues import CueFusion, FrameMaps, Match
from pf_tracker_ros.parameters import ParameterError


class ScriptedCue:
    """A cue whose likelihood is written down: template times the box's x."""

    def __init__(self):
        self.asked = 0

    def learn(self, maps, box):
        return float(box[0])

    def log_likelihood(self, maps, boxes, template):
        self.asked += 1
        return -template * boxes[:, 0]

    def match(self, seen, template):
        return Match(-template * seen, 1 / (template + seen))

    def blend(self, template, seen, keep):
        return keep * template + (1 - keep) * seen


BOXES = np.array([[1.0, 0.0, 4.0, 4.0], [2.0, 0.0, 4.0, 4.0]])
MAPS = FrameMaps(np.zeros((10, 10), np.uint8), BOXES)


def test_the_fused_likelihood_is_the_product_of_powers():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    fused = np.exp(fusion.log_likelihood(MAPS, BOXES, (1.0, 5.0)))
    likelihood_a, likelihood_b = np.exp(-BOXES[:, 0]), np.exp(-5.0 * BOXES[:, 0])
    np.testing.assert_allclose(fused, likelihood_a**0.6 * likelihood_b**0.4)
    seen = fusion.learn(MAPS, BOXES[1])
    match = fusion.match(seen, (1.0, 5.0))
    assert np.exp(match.log_likelihood) == pytest.approx(fused[1])
    assert match.similarity == pytest.approx((1 / 3) ** 0.6 * (1 / 7) ** 0.4)


def test_powers_are_scaled_to_a_sum_of_one():
    fusion = CueFusion({name: (ScriptedCue(), 0.5) for name in "abc"})
    np.testing.assert_allclose(fusion.powers, [1 / 3] * 3)


def test_a_cue_of_power_zero_is_never_asked():
    off = ScriptedCue()
    fusion = CueFusion({"on": (ScriptedCue(), 1.0), "off": (off, 0.0)})
    templates = fusion.learn(MAPS, BOXES[0])
    assert fusion.names == ("on",)
    np.testing.assert_allclose(fusion.log_likelihood(MAPS, BOXES, templates), -BOXES[:, 0])
    assert off.asked == 0


def test_every_template_is_blended():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    assert fusion.blend((1.0, 0.0), (0.0, 1.0), 0.75) == (0.75, 0.25)


def test_all_cues_off_is_refused_naming_their_powers():
    with pytest.raises(ParameterError, match=r"'a\.power', 'b\.power' must be above 0"):
        CueFusion({"a": (ScriptedCue(), 0.0), "b": (ScriptedCue(), 0.0)})
