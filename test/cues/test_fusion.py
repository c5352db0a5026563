"""Fusion: a product of powers for any number of cues."""

import numpy as np
import pytest

from pf_tracker_ros.cues import CueFusion, FrameMaps, Match
from pf_tracker_ros.parameters import ParameterError


class ScriptedCue:
    """A cue whose likelihood is written down: template times the box's x."""

    def __init__(self, reach=0.0, steady_keep=None):
        self.asked = 0
        self.reach = reach
        self.steady_keep = steady_keep

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
    fused = np.exp(fusion.log_likelihood(MAPS, BOXES, {"a": 1.0, "b": 5.0}))
    likelihood_a, likelihood_b = np.exp(-BOXES[:, 0]), np.exp(-5.0 * BOXES[:, 0])
    np.testing.assert_allclose(fused, likelihood_a**0.6 * likelihood_b**0.4)
    seen = fusion.learn(MAPS, BOXES[1])
    match = fusion.match(seen, {"a": 1.0, "b": 5.0})
    assert np.exp(match.log_likelihood) == pytest.approx(fused[1])
    assert match.similarity == pytest.approx((1 / 3) ** 0.6 * (1 / 7) ** 0.4)


def test_a_cue_that_cannot_tell_leaves_the_match_to_the_others():
    silent = ScriptedCue()
    silent.match = lambda seen, template: None
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "silent": (silent, 0.5)})
    seen = fusion.learn(MAPS, BOXES[1])
    assert fusion.match(seen, {"a": 1.0, "silent": 1.0}) == Match(-2.0, 1 / 3)
    alone = CueFusion({"silent": (silent, 1.0)})
    assert alone.match({"silent": 2.0}, {"silent": 1.0}) == Match(0.0, 1.0)


def test_powers_are_scaled_to_a_sum_of_one():
    fusion = CueFusion({name: (ScriptedCue(), 0.5) for name in "abc"})
    assert fusion.powers == pytest.approx(dict.fromkeys("abc", 1 / 3))


def test_a_cue_of_power_zero_is_never_asked():
    off = ScriptedCue()
    fusion = CueFusion({"on": (ScriptedCue(), 1.0), "off": (off, 0.0)})
    templates = fusion.learn(MAPS, BOXES[0])
    assert list(templates) == ["on"]
    np.testing.assert_allclose(fusion.log_likelihood(MAPS, BOXES, templates), -BOXES[:, 0])
    assert off.asked == 0


def test_a_trusted_frame_blends_every_template_and_another_only_the_steady_ones():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(steady_keep=0.5), 0.4)})
    old, seen = {"a": 1.0, "b": 0.0}, {"a": 0.0, "b": 1.0}
    assert fusion.updated(old, seen, trusted=True, keep=0.75) == {"a": 0.75, "b": 0.5}
    assert fusion.updated(old, seen, trusted=False, keep=0.75) == {"a": 1.0, "b": 0.5}


def test_a_cue_switched_on_later_says_nothing_until_it_has_learned():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "b": (ScriptedCue(), 0.5)})
    fused = fusion.log_likelihood(MAPS, BOXES, {"a": 2.0})
    np.testing.assert_allclose(fused, -0.5 * 2.0 * BOXES[:, 0])
    seen = fusion.learn(MAPS, BOXES[1])
    assert fusion.match(seen, {"a": 2.0}).log_likelihood == -2.0 * 2.0
    assert fusion.updated({"a": 2.0}, seen, trusted=False, keep=0.9) == {"a": 2.0, "b": 2.0}


def test_the_reach_is_that_of_the_cue_that_looks_furthest():
    fusion = CueFusion(
        {"near": (ScriptedCue(), 0.5), "far": (ScriptedCue(reach=0.4), 0.5)}
        | {"off": (ScriptedCue(reach=3.0), 0.0)}
    )
    assert fusion.reach == 0.4


def test_all_cues_off_is_refused_naming_their_powers():
    with pytest.raises(ParameterError, match=r"'a\.power', 'b\.power' must be above 0"):
        CueFusion({"a": (ScriptedCue(), 0.0), "b": (ScriptedCue(), 0.0)})
