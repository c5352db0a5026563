"""Fusion: the weighted product of the likelihoods of several cues."""

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
    """A cue with the log likelihood -template * x of the box."""

    context_margin = 0.0

    def __init__(self, context_margin=0.0, keep=0.5):
        self.calls = 0
        self.context_margin = context_margin
        self.keep = keep

    def learn(self, region, box):
        return float(box[0])

    def log_likelihood(self, region, boxes, template):
        self.calls += 1
        return -template * boxes[:, 0]

    def match(self, observation, template):
        return Match(-template * observation, 1 / (template + observation))

    def blend(self, template, observation):
        return self.keep * template + (1 - self.keep) * observation


class SearchingCue(ScriptedCue, SearchableCue):
    """Its response is 1 / x."""

    def response(self, region, boxes, template):
        return 1.0 / boxes[:, 0]

    def log_likelihood_of(self, response, template):
        return -template * (1.0 - response)

    def log_likelihood(self, region, boxes, template):
        return self.log_likelihood_of(self.response(region, boxes, template), template)


class JoiningCue(ScriptedCue):
    """Cheap for many boxes, but does not find the target alone."""

    joins_search = True


class ContrastCue(ScriptedCue):
    """Not discriminative."""

    is_discriminative = False


class DeferringCue(ScriptedCue):
    """Defers its work: it observes the box, not a template."""

    def observe(self, region, box):
        return ("observed", float(box[0]))

    def template_from(self, observation):
        return 10.0 * observation[1]

    def match(self, observation, template):
        return super().match(observation[1], template)

    def blend(self, template, observation):
        return super().blend(template, observation[1])


BOXES = np.array([[1.0, 0.0, 4.0, 4.0], [2.0, 0.0, 4.0, 4.0]])
GRID = BoxGrid(np.array([1.0, 2.0, 4.0]), np.array([5.0, 6.0]), np.array([3.0, 3.0]))
REGION = Region(Frame(np.zeros((10, 10), np.uint8)), BOXES)


def test_the_fused_likelihood_is_the_weighted_product():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    fused = np.exp(fusion.log_likelihood(REGION, BOXES, {"a": 1.0, "b": 5.0}))
    likelihood_a, likelihood_b = np.exp(-BOXES[:, 0]), np.exp(-5.0 * BOXES[:, 0])
    np.testing.assert_allclose(fused, likelihood_a**0.6 * likelihood_b**0.4)
    observation = fusion.learn(REGION, BOXES[1])
    match = fusion.match(observation, {"a": 1.0, "b": 5.0})
    assert np.exp(match.log_likelihood) == pytest.approx(fused[1])
    assert match.similarity == pytest.approx((1 / 3) ** 0.6 * (1 / 7) ** 0.4)


def test_a_cue_that_cannot_decide_leaves_the_match_to_the_others():
    undecided = ScriptedCue()
    undecided.match = lambda observation, template: None
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "undecided": (undecided, 0.5)})
    observation = fusion.learn(REGION, BOXES[1])
    assert fusion.match(observation, {"a": 1.0, "undecided": 1.0}) == Match(-2.0, 1 / 3)
    alone = CueFusion({"undecided": (undecided, 1.0)})
    assert alone.match({"undecided": 2.0}, {"undecided": 1.0}) == Match(0.0, 1.0)


def test_weights_are_scaled_to_a_sum_of_one():
    fusion = CueFusion({name: (ScriptedCue(), 0.5) for name in "abc"})
    assert fusion.cue_weights == pytest.approx(dict.fromkeys("abc", 1 / 3))


def test_a_cue_of_weight_zero_is_never_called():
    off = ScriptedCue()
    fusion = CueFusion({"on": (ScriptedCue(), 1.0), "off": (off, 0.0)})
    templates = fusion.learn(REGION, BOXES[0])
    assert list(templates) == ["on"]
    np.testing.assert_allclose(fusion.log_likelihood(REGION, BOXES, templates), -BOXES[:, 0])
    assert off.calls == 0


def test_an_update_blends_every_template_by_its_cue():
    fusion = CueFusion({"a": (ScriptedCue(keep=0.75), 0.6), "b": (ScriptedCue(keep=0.5), 0.4)})
    old, observation = {"a": 1.0, "b": 0.0}, {"a": 0.0, "b": 1.0}
    assert fusion.update(old, observation) == {"a": 0.75, "b": 0.5}
    assert old == {"a": 1.0, "b": 0.0}


def test_a_cue_without_a_template_is_ignored_until_an_update():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "b": (ScriptedCue(), 0.5)})
    fused = fusion.log_likelihood(REGION, BOXES, {"a": 2.0})
    np.testing.assert_allclose(fused, -0.5 * 2.0 * BOXES[:, 0])
    observation = fusion.learn(REGION, BOXES[1])
    assert fusion.match(observation, {"a": 2.0}).log_likelihood == -2.0 * 2.0
    assert fusion.update({"a": 2.0}, observation) == {"a": 2.0, "b": 2.0}


def test_an_observation_is_a_template_unless_the_cue_defers_it():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "deferring": (DeferringCue(), 0.5)})
    assert fusion.learn(REGION, BOXES[1]) == {"a": 2.0, "deferring": 2.0}
    assert fusion.observe(REGION, BOXES[1]) == {"a": 2.0, "deferring": ("observed", 2.0)}


def test_an_observation_is_matched_and_blended():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "deferring": (DeferringCue(), 0.5)})
    observation, templates = fusion.observe(REGION, BOXES[1]), {"a": 1.0, "deferring": 5.0}
    match = fusion.match(observation, templates)
    assert match.log_likelihood == pytest.approx(-0.5 * 2.0 - 0.5 * 10.0)
    assert match.similarity == pytest.approx((1 / 3) ** 0.5 * (1 / 7) ** 0.5)
    assert fusion.update(templates, observation) == {"a": 1.5, "deferring": 3.5}


def test_a_cue_without_a_template_converts_its_observation():
    cues = {"a": (ScriptedCue(), 0.5), "deferring": (DeferringCue(), 0.5)}
    fusion = CueFusion(cues)
    observation = fusion.observe(REGION, BOXES[1])
    assert fusion.update({"a": 2.0}, observation) == {"a": 2.0, "deferring": 20.0}


def test_the_template_of_a_cue_switched_off_is_kept():
    fusion = CueFusion({"a": (ScriptedCue(), 1.0), "off": (ScriptedCue(), 0.0)})
    observation = fusion.observe(REGION, BOXES[1])
    assert fusion.update({"a": 1.0, "off": 7.0}, observation) == {"a": 1.5, "off": 7.0}


def test_only_discriminative_cues_count_in_the_similarity_if_there_are_any():
    both = CueFusion({"discriminative": (ScriptedCue(), 0.5), "other": (ContrastCue(), 0.5)})
    observation, templates = (
        {"discriminative": 2.0, "other": 7.0},
        {"discriminative": 2.0, "other": 1.0},
    )
    match = both.match(observation, templates)
    assert match.similarity == pytest.approx(1 / 4)
    assert match.log_likelihood == pytest.approx(-0.5 * 4.0 - 0.5 * 7.0)
    alone = CueFusion({"other": (ContrastCue(), 0.5)})
    assert alone.match({"other": 7.0}, {"other": 1.0}).similarity == pytest.approx(1 / 8)


def test_a_search_uses_the_searchable_cues():
    fusion = CueFusion({"plain": (ScriptedCue(), 0.5), "searching": (SearchingCue(), 0.5)})
    assert fusion.can_search
    assert not CueFusion({"plain": (ScriptedCue(), 0.5)}).can_search
    templates = {"plain": 1.0, "searching": 6.0}
    responses = fusion.responses(REGION, BOXES, templates)
    assert list(responses) == ["searching"]
    np.testing.assert_allclose(responses["searching"], [1.0, 0.5])
    on_grid = fusion.responses_on_grid(REGION, GRID, templates)
    assert list(on_grid) == ["searching"]
    np.testing.assert_allclose(on_grid["searching"], [1.0, 0.5, 0.25] * 2)
    cue_weights = {"plain": 0.2, "searching": 0.8}
    likelihood = fusion.search(REGION, GRID, on_grid, templates, cue_weights)
    np.testing.assert_allclose(likelihood, -0.8 * 6.0 * np.array([0.0, 0.5, 0.75] * 2))


def test_a_cue_that_joins_a_search_is_added_but_cannot_search_alone():
    fusion = CueFusion({"joining": (JoiningCue(), 0.5), "searching": (SearchingCue(), 0.5)})
    assert not CueFusion({"joining": (JoiningCue(), 1.0)}).can_search
    templates, cue_weights = {"joining": 3.0, "searching": 6.0}, {"joining": 0.1, "searching": 0.9}
    responses = fusion.responses_on_grid(REGION, GRID, templates)
    assert list(responses) == ["searching"]
    likelihood = fusion.search(REGION, GRID, responses, templates, cue_weights)
    expected = -0.9 * 6.0 * np.array([0.0, 0.5, 0.75] * 2)
    np.testing.assert_allclose(likelihood, expected - 0.1 * 3.0 * np.array([1.0, 2.0, 4.0] * 2))
    # Without a template it is ignored.
    del templates["joining"]
    likelihood = fusion.search(REGION, GRID, responses, templates, cue_weights)
    np.testing.assert_allclose(likelihood, expected)


def test_given_weights_replace_the_configured_ones():
    fusion = CueFusion({"a": (ScriptedCue(), 0.5), "b": (ScriptedCue(), 0.5)})
    fused = fusion.log_likelihood(REGION, BOXES, {"a": 1.0, "b": 3.0}, {"a": 0.9, "b": 0.1})
    np.testing.assert_allclose(fused, -(0.9 * 1.0 + 0.1 * 3.0) * BOXES[:, 0])


def test_the_distractor_ratio_is_the_largest_response_beside_the_target_over_its_own():
    beside = {"a": np.array([0.1, 0.4]), "b": np.array([-0.2]), "c": np.array([])}
    found = measure_distractor_ratios({"a": 0.8, "b": 0.5, "c": 0.5}, beside)
    assert found == pytest.approx({"a": 0.5, "b": 0.0, "c": 0.0})
    # Without a response at the target, the ratio is limited.
    assert measure_distractor_ratios({"a": 0.0}, beside) == {"a": 2.0}
    smooth = smooth_distractor_ratios({"a": 1.0}, {"a": 0.5, "new": 0.3})
    assert smooth == pytest.approx({"a": 0.95, "new": 0.3})


@given(
    ratios=st.dictionaries(st.sampled_from("abc"), st.floats(0.0, 2.0), max_size=3),
    adaptation=st.floats(0.0, 10.0),
)
def test_adapted_weights_sum_to_one_and_rise_for_small_ratios(ratios, adaptation):
    fusion = CueFusion({name: (ScriptedCue(), 0.25) for name in "abcd"})
    cue_weights = fusion.adapt(ratios, adaptation)
    assert sum(cue_weights.values()) == pytest.approx(1.0)
    assert min(cue_weights.values()) > 0.0
    by_ratio = sorted(ratios, key=ratios.get)
    for smaller, larger in itertools.pairwise(by_ratio):
        assert cue_weights[smaller] >= cue_weights[larger] - 1e-12
    if not ratios or adaptation == 0.0:
        assert cue_weights == fusion.cue_weights


def test_adapted_weights_by_hand():
    fusion = CueFusion({"a": (ScriptedCue(), 0.6), "b": (ScriptedCue(), 0.4)})
    # The mean ratio is 0.5: factors 1 + 1.5 * 0.3 and 1 - 1.5 * 0.3.
    cue_weights = fusion.adapt({"a": 0.2, "b": 0.8}, 1.5)
    total = 0.6 * 1.45 + 0.4 * 0.55
    assert cue_weights == pytest.approx({"a": 0.6 * 1.45 / total, "b": 0.4 * 0.55 / total})


def test_the_context_margin_is_the_largest_of_the_cues():
    fusion = CueFusion(
        {"near": (ScriptedCue(), 0.5), "far": (ScriptedCue(context_margin=0.4), 0.5)}
        | {"off": (ScriptedCue(context_margin=3.0), 0.0)}
    )
    assert fusion.context_margin == 0.4


def test_all_cues_off_is_rejected_with_the_names_of_their_weights():
    with pytest.raises(ParameterError, match=r"'a\.weight', 'b\.weight' must be above 0"):
        CueFusion({"a": (ScriptedCue(), 0.0), "b": (ScriptedCue(), 0.0)})
