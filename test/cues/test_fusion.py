"""Fusion: a product of powers for any number of cues."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues import Cue, CueFusion, Match, SearchableCue
from pf_tracker_ros.cues.fusion import measure_distractor_ratios, smooth_distractor_ratios
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.parameters import ParameterError


class ScriptedCue(Cue):
    """A cue whose likelihood is written down: template times the box's x."""

    context_margin = 0.0

    def __init__(self, context_margin=0.0, keep=0.5):
        self.asked = 0
        self.context_margin = context_margin
        self.keep = keep

    def learn(self, region, box):
        return float(box[0])

    def log_likelihood(self, region, boxes, template):
        self.asked += 1
        return -template * boxes[:, 0]

    def match(self, seen, template):
        return Match(-template * seen, 1 / (template + seen))

    def blend(self, template, seen):
        return self.keep * template + (1 - self.keep) * seen


class SearchingCue(ScriptedCue, SearchableCue):
    """Its strength is 1 / x."""

    def response(self, region, boxes, template):
        return 1.0 / boxes[:, 0]

    def log_likelihood_of(self, strength, template):
        return -template * (1.0 - strength)

    def log_likelihood(self, region, boxes, template):
        return self.log_likelihood_of(self.response(region, boxes, template), template)


class JoiningCue(ScriptedCue):
    """Cheap to ask everywhere, but knows no target."""

    joins_search = True


class ContrastCue(ScriptedCue):
    """Can't judge: similar to whatever stands out."""

    is_discriminative = False


class LateCue(ScriptedCue):
    """Puts off its work: what it observes is the box, not a template."""

    def observe(self, region, box):
        return ("seen", float(box[0]))

    def template_from(self, seen):
        return 10.0 * seen[1]

    def match(self, seen, template):
        return super().match(seen[1], template)

    def blend(self, template, seen):
        return super().blend(template, seen[1])


BOXES = np.array([[1.0, 0.0, 4.0, 4.0], [2.0, 0.0, 4.0, 4.0]])
GRID = BoxGrid(np.array([1.0, 2.0, 4.0]), np.array([5.0, 6.0]), np.array([3.0, 3.0]))
REGION = Region(Frame(np.zeros((10, 10), np.uint8)), BOXES)


def test_the_fused_likelihood_is_the_product_of_powers():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    fused = np.exp(fusion.log_likelihood(REGION, BOXES, {"a": 1.0, "b": 5.0}))
    likelihood_a, likelihood_b = np.exp(-BOXES[:, 0]), np.exp(-5.0 * BOXES[:, 0])
    np.testing.assert_allclose(fused, likelihood_a**0.6 * likelihood_b**0.4)
    seen = fusion.learn(REGION, BOXES[1])
    match = fusion.match(seen, {"a": 1.0, "b": 5.0})
    assert np.exp(match.log_likelihood) == pytest.approx(fused[1])
    assert match.similarity == pytest.approx((1 / 3) ** 0.6 * (1 / 7) ** 0.4)


def test_a_cue_that_cannot_tell_leaves_the_match_to_the_others():
    silent = ScriptedCue()
    silent.match = lambda seen, template: None
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "silent": (silent, 0.5)})
    seen = fusion.learn(REGION, BOXES[1])
    assert fusion.match(seen, {"a": 1.0, "silent": 1.0}) == Match(-2.0, 1 / 3)
    alone = CueFusion({"silent": (silent, 1.0)})
    assert alone.match({"silent": 2.0}, {"silent": 1.0}) == Match(0.0, 1.0)


def test_powers_are_scaled_to_a_sum_of_one():
    fusion = CueFusion({name: (ScriptedCue(), 0.5) for name in "abc"})
    assert fusion.cue_weights == pytest.approx(dict.fromkeys("abc", 1 / 3))


def test_a_cue_of_power_zero_is_never_asked():
    off = ScriptedCue()
    fusion = CueFusion({"on": (ScriptedCue(), 1.0), "off": (off, 0.0)})
    templates = fusion.learn(REGION, BOXES[0])
    assert list(templates) == ["on"]
    np.testing.assert_allclose(fusion.log_likelihood(REGION, BOXES, templates), -BOXES[:, 0])
    assert off.asked == 0


def test_an_update_blends_every_template_as_its_own_cue_says():
    fusion = CueFusion({"a": (ScriptedCue(keep=0.75), 0.6), "b": (ScriptedCue(keep=0.5), 0.4)})
    old, seen = {"a": 1.0, "b": 0.0}, {"a": 0.0, "b": 1.0}
    assert fusion.update(old, seen) == {"a": 0.75, "b": 0.5}
    assert old == {"a": 1.0, "b": 0.0}


def test_a_cue_switched_on_later_says_nothing_until_it_has_learned():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "b": (ScriptedCue(), 0.5)})
    fused = fusion.log_likelihood(REGION, BOXES, {"a": 2.0})
    np.testing.assert_allclose(fused, -0.5 * 2.0 * BOXES[:, 0])
    seen = fusion.learn(REGION, BOXES[1])
    assert fusion.match(seen, {"a": 2.0}).log_likelihood == -2.0 * 2.0
    assert fusion.update({"a": 2.0}, seen) == {"a": 2.0, "b": 2.0}


def test_a_cue_observes_what_it_would_learn_unless_it_puts_that_off():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "late": (LateCue(), 0.5)})
    assert fusion.learn(REGION, BOXES[1]) == {"a": 2.0, "late": 2.0}
    assert fusion.observe(REGION, BOXES[1]) == {"a": 2.0, "late": ("seen", 2.0)}


def test_what_was_observed_is_matched_and_blended():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "late": (LateCue(), 0.5)})
    seen, templates = fusion.observe(REGION, BOXES[1]), {"a": 1.0, "late": 5.0}
    match = fusion.match(seen, templates)
    assert match.log_likelihood == pytest.approx(-0.5 * 2.0 - 0.5 * 10.0)
    assert match.similarity == pytest.approx((1 / 3) ** 0.5 * (1 / 7) ** 0.5)
    assert fusion.update(templates, seen) == {"a": 1.5, "late": 3.5}


def test_a_cue_switched_on_later_adopts_what_it_observed():
    cues = {"a": (ScriptedCue(), 0.5), "late": (LateCue(), 0.5)}
    fusion = CueFusion(cues)
    seen = fusion.observe(REGION, BOXES[1])
    assert fusion.update({"a": 2.0}, seen) == {"a": 2.0, "late": 20.0}


def test_the_template_of_a_cue_switched_off_is_kept():
    fusion = CueFusion({"a": (ScriptedCue(), 1.0), "off": (ScriptedCue(), 0.0)})
    seen = fusion.observe(REGION, BOXES[1])
    assert fusion.update({"a": 1.0, "off": 7.0}, seen) == {"a": 1.5, "off": 7.0}


def test_only_cues_that_judge_count_in_the_similarity_if_there_are_any():
    both = CueFusion({"judge": (ScriptedCue(), 0.5), "other": (ContrastCue(), 0.5)})
    seen, templates = {"judge": 2.0, "other": 7.0}, {"judge": 2.0, "other": 1.0}
    match = both.match(seen, templates)
    assert match.similarity == pytest.approx(1 / 4)
    assert match.log_likelihood == pytest.approx(-0.5 * 4.0 - 0.5 * 7.0)
    alone = CueFusion({"other": (ContrastCue(), 0.5)})
    assert alone.match({"other": 7.0}, {"other": 1.0}).similarity == pytest.approx(1 / 8)


def test_a_search_asks_the_cues_that_can():
    fusion = CueFusion({"plain": (ScriptedCue(), 0.5), "searching": (SearchingCue(), 0.5)})
    assert fusion.can_search
    assert not CueFusion({"plain": (ScriptedCue(), 0.5)}).can_search
    templates = {"plain": 1.0, "searching": 6.0}
    strengths = fusion.responses(REGION, BOXES, templates)
    assert list(strengths) == ["searching"]
    np.testing.assert_allclose(strengths["searching"], [1.0, 0.5])
    on_grid = fusion.responses_on_grid(REGION, GRID, templates)
    assert list(on_grid) == ["searching"]
    np.testing.assert_allclose(on_grid["searching"], [1.0, 0.5, 0.25] * 2)
    cue_weights = {"plain": 0.2, "searching": 0.8}
    likelihood = fusion.search(REGION, GRID, on_grid, templates, cue_weights)
    np.testing.assert_allclose(likelihood, -0.8 * 6.0 * np.array([0.0, 0.5, 0.75] * 2))


def test_a_cue_that_joins_a_search_has_its_say_and_leads_none():
    fusion = CueFusion({"joining": (JoiningCue(), 0.5), "searching": (SearchingCue(), 0.5)})
    assert not CueFusion({"joining": (JoiningCue(), 1.0)}).can_search
    templates, cue_weights = {"joining": 3.0, "searching": 6.0}, {"joining": 0.1, "searching": 0.9}
    strengths = fusion.responses_on_grid(REGION, GRID, templates)
    assert list(strengths) == ["searching"]
    likelihood = fusion.search(REGION, GRID, strengths, templates, cue_weights)
    led = -0.9 * 6.0 * np.array([0.0, 0.5, 0.75] * 2)
    np.testing.assert_allclose(likelihood, led - 0.1 * 3.0 * np.array([1.0, 2.0, 4.0] * 2))
    # Without a template yet, it says nothing.
    del templates["joining"]
    likelihood = fusion.search(REGION, GRID, strengths, templates, cue_weights)
    np.testing.assert_allclose(likelihood, led)


def test_given_powers_take_the_place_of_the_configured_ones():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "b": (ScriptedCue(), 0.5)})
    fused = fusion.log_likelihood(REGION, BOXES, {"a": 1.0, "b": 3.0}, {"a": 0.9, "b": 0.1})
    np.testing.assert_allclose(fused, -(0.9 * 1.0 + 0.1 * 3.0) * BOXES[:, 0])


def test_distraction_is_the_strongest_place_beside_the_target_over_its_own():
    beside = {"a": np.array([0.1, 0.4]), "b": np.array([-0.2]), "c": np.array([])}
    found = measure_distractor_ratios({"a": 0.8, "b": 0.5, "c": 0.5}, beside)
    assert found == pytest.approx({"a": 0.5, "b": 0.0, "c": 0.0})
    # Without any strength of its own a cue is at the largest distraction, not at infinity.
    assert measure_distractor_ratios({"a": 0.0}, beside) == {"a": 2.0}
    smooth = smooth_distractor_ratios({"a": 1.0}, {"a": 0.5, "new": 0.3})
    assert smooth == pytest.approx({"a": 0.95, "new": 0.3})


@given(
    distracted=st.dictionaries(st.sampled_from("abc"), st.floats(0.0, 2.0), max_size=3),
    adaptation=st.floats(0.0, 10.0),
)
def test_adapted_powers_sum_to_one_and_follow_what_stands_out(distracted, adaptation):
    fusion = CueFusion({name: (ScriptedCue(), 0.25) for name in "abcd"})
    cue_weights = fusion.adapt(distracted, adaptation)
    assert sum(cue_weights.values()) == pytest.approx(1.0)
    assert min(cue_weights.values()) > 0.0
    by_distraction = sorted(distracted, key=distracted.get)
    for clearer, more_confused in itertools.pairwise(by_distraction):
        assert cue_weights[clearer] >= cue_weights[more_confused] - 1e-12
    if not distracted or adaptation == 0.0:
        assert cue_weights == fusion.cue_weights


def test_adapted_powers_by_hand():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    # The mean distraction is 0.5: factors 1 + 1.5 * 0.3 and 1 - 1.5 * 0.3.
    cue_weights = fusion.adapt({"a": 0.2, "b": 0.8}, 1.5)
    total = 0.6 * 1.45 + 0.4 * 0.55
    assert cue_weights == pytest.approx({"a": 0.6 * 1.45 / total, "b": 0.4 * 0.55 / total})


def test_the_reach_is_that_of_the_cue_that_looks_furthest():
    fusion = CueFusion(
        {"near": (ScriptedCue(), 0.5), "far": (ScriptedCue(context_margin=0.4), 0.5)}
        | {"off": (ScriptedCue(context_margin=3.0), 0.0)}
    )
    assert fusion.context_margin == 0.4


def test_all_cues_off_is_refused_naming_their_powers():
    with pytest.raises(ParameterError, match=r"'a\.weight', 'b\.weight' must be above 0"):
        CueFusion({"a": (ScriptedCue(), 0.0), "b": (ScriptedCue(), 0.0)})
