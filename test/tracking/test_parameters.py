"""The tracker's parameters: values, conditions and changes at run time."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
from pf_tracker_ros.parameters import ParameterError, build, declarations, flatten
from pf_tracker_ros.tracking.occlusion import OCCLUSION_POLICIES
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

INTERVAL = 0.04
EVERY = declarations(TrackerParameters)
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def box(boxes, index):
    return tuple(boxes[index].tolist())


# Values and conditions


@every_preset
def test_every_preset_builds_and_has_its_values(preset):
    values = preset_parameters(preset)
    assert PRESETS[preset].items() <= values.items()
    others = values.keys() - PRESETS[preset].keys()
    assert all(values[name] == EVERY[name].default for name in others)
    assert list(values) == list(EVERY)
    assert flatten(build(TrackerParameters, values)) == values
    assert Tracker.from_preset(preset).parameters == values


def test_every_registered_part_can_be_selected():
    assert EVERY["cues"].choices == tuple(CUES)
    assert EVERY["motion.model"].choices == tuple(MOTION_MODELS)
    assert EVERY["resampling.scheme"].choices == tuple(RESAMPLERS)
    assert EVERY["track.occlusion_policy"].choices == tuple(OCCLUSION_POLICIES)


OF_SEARCH = ("proposal.method", ("search",))
WITH_VELOCITY = ("affine", "constant_velocity", "constant_velocity_and_size")
CONDITIONS = {
    "particles": None,
    "motion.position_noise": None,
    "motion.velocity_noise": ("motion.model", WITH_VELOCITY),
    "motion.drift": ("motion.model", ("affine",)),
    "motion.second_coefficient": ("motion.model", ("second_order_autoregressive",)),
    "proposal.share": ("proposal.method", ("kalman", "search")),
    "proposal.window": OF_SEARCH,
    "fusion.adaptation": OF_SEARCH,
    "redetection.windows": OF_SEARCH,
    "redetection.mode": OF_SEARCH,
    "hog.weight": ("cues", ("hog",)),
    "foreground_color_histogram.keep": ("cues", ("foreground_color_histogram",)),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_parameter_of_a_part_counts_while_the_part_is_selected(name):
    assert EVERY[name].condition == CONDITIONS[name]
    if CONDITIONS[name]:
        assert EVERY[name].description.endswith("'.")
        assert f" Used only if '{CONDITIONS[name][0]}' " in EVERY[name].description


@pytest.mark.parametrize("preset", PRESETS)
def test_a_value_of_a_part_that_is_not_selected_changes_nothing(preset, couple, other_values):
    values = preset_parameters(preset)
    idle = {name: one for name, one in EVERY.items() if not one.is_active(values)}
    assert idle
    changes = {name: other_values(one, values[name])[0] for name, one in idle.items()}
    tracker = Tracker.from_preset(preset)
    others = [Tracker.from_preset(preset, parameters=changes), Tracker.from_preset(preset)]
    for one in (tracker, *others):
        one.start(couple.images[0], box(couple.first, 0))
    # Also values that are fixed while a target is tracked.
    others[1].set_parameters(changes)
    assert others[0].parameters == others[1].parameters == values | changes
    for image in couple.images[1:6]:
        estimate = tracker.update(image)
        for other in others:
            found = other.update(image)
            assert found.box == estimate.box
            np.testing.assert_array_equal(found.weights, estimate.weights)


def test_a_selected_part_has_the_values_that_were_set_before(couple):
    values = {"motion.size_noise": 0.7, "motion.aspect_noise": 0.2, "hog.sharpness": 90.0}
    selection = {"motion.model": "second_order_autoregressive", "cues": ("hog",)}
    tracker = Tracker.from_preset("li2007", seed=3, parameters=values)
    tracker.set_parameters(selection)
    other = Tracker.from_preset("li2007", seed=3, parameters=values | selection)
    for one in (tracker, other):
        one.start(couple.images[0], box(couple.first, 0))
    for image in couple.images[1:4]:
        assert tracker.update(image).box == other.update(image).box


def test_a_single_cue_has_all_of_the_weight(couple):
    for weight in (0.01, 0.5, 1.0):
        tracker = Tracker.from_preset("zhang2015", parameters={"hog.weight": weight})
        assert dict(tracker.start(couple.images[0], box(couple.first, 0)).cue_weights) == {
            "hog": 1.0
        }
    with pytest.raises(ParameterError, match=r"all cues are off; .* 'hog\.weight' must be above 0"):
        Tracker.from_preset("zhang2015", parameters={"hog.weight": 0.0})


# Changes at run time


@pytest.fixture
def make_tracker(couple):
    """A function that makes a tracker of the first target."""

    def make(preset, parameters=None):
        tracker = Tracker.from_preset(preset, seed=5, parameters=parameters)
        tracker.start(couple.images[0], couple.first[0])
        return tracker

    return make


def filter_state(tracker):
    (track,) = tracker._manager._track_set.tracks
    return track.filter_state


def learned_cues(tracker):
    return {*filter_state(tracker).templates}


def test_a_cue_that_is_added_learns_from_the_next_frame_that_is_trusted(make_tracker, couple):
    never = {"template.update_above": 1.0}
    more = {"cues": ("color_histogram", "gradient_orientation", "hog")}
    tracker = make_tracker("li2007", never)
    tracker.set_parameters(more)
    for image in couple.images[1:4]:
        tracker.update(image, INTERVAL)
        assert learned_cues(tracker) == {"color_histogram", "gradient_orientation"}
        assert tracker.estimate.cue_weights.keys() == {*more["cues"]}
    tracker.set_parameters({"template.update_above": 0.2})
    tracker.update(couple.images[4], INTERVAL)
    assert learned_cues(tracker) == {*more["cues"]}
    # It contributes to the next frame: without it the weights differ.
    other = make_tracker("li2007")
    for image in couple.images[1:5]:
        other.update(image, INTERVAL)
    for one in (tracker, other):
        one.update(couple.images[5], INTERVAL)
    weights = [one.estimate.weights for one in (tracker, other)]
    assert not np.allclose(*weights)


def test_the_template_of_a_removed_cue_is_deleted_at_once(make_tracker, couple):
    """Else a template of one window would be compared with another window."""
    never = {"template.update_above": 1.0, "template.similarity_above": 0.0}
    tracker = make_tracker("default", never)
    assert learned_cues(tracker) == {"color_contrast", "correlation_response"}
    tracker.set_parameters({"cues": ("color_contrast",)})
    assert learned_cues(tracker) == {"color_contrast"}
    assert filter_state(tracker).distractor_ratios.keys() == {"color_contrast"}
    both = ("color_contrast", "correlation_response")
    tracker.set_parameters({"cues": both, "correlation_response.window": 6.0})
    tracker.update(couple.images[1], INTERVAL)
    assert learned_cues(tracker) == {"color_contrast"}
    tracker.set_parameters({"template.update_above": 0.0, "template.similarity_above": 0.33})
    tracker.update(couple.images[2], INTERVAL)
    assert learned_cues(tracker) == {"color_contrast", "correlation_response"}


def test_cues_are_added_removed_and_weighted_while_tracking(couple):
    tracker = Tracker.from_preset("default")
    tracker.start(couple.images[0], couple.second[0])
    changes = {
        1: ({"cues": ("color_contrast", "correlation_response", "hog"), "hog.weight": 1.0}, None),
        4: ({"hog.weight": 0.5}, None),
        7: ({"cues": ("correlation_response", "hog")}, None),
        10: ({"hog.weight": 0.0}, {"correlation_response": 1.0}),
        13: ({"cues": ("correlation_response", "color_contrast")}, None),
        16: ({"cues": ("color_contrast",)}, {"color_contrast": 1.0}),
    }
    for index in range(1, len(couple.images)):
        values, cue_weights = changes.get(index, ({}, None))
        if values:
            tracker.set_parameters(values)
            assert values.items() <= tracker.parameters.items()
        estimate = tracker.update(couple.images[index])
        assert estimate.box == pytest.approx(couple.second[index], abs=8)
        now = tracker.parameters
        used = [name for name in now["cues"] if now[f"{name}.weight"]]
        assert estimate.cue_weights.keys() == {*used}
        if cue_weights:
            assert dict(estimate.cue_weights) == cue_weights


@pytest.mark.parametrize(
    "values",
    [
        {"cues": ("hog",)},
        {"cues": ("hog", "color_contrast", "foreground")},
        {"cues": ("hog", "color_histogram"), "color_histogram.weight": 0.0},
    ],
)
def test_cues_without_any_template_learn_the_target_where_it_was_last_seen(values, couple):
    """Else they would learn its occluder."""
    tracker, black = Tracker.from_preset("li2007", seed=5), np.zeros_like(couple.images[0])
    tracker.start(couple.images[0], couple.first[0])
    # A cue that is selected while the target is occluded learns nothing yet.
    tracker.set_parameters({"cues": ("color_histogram", "gradient_orientation", "hog")})
    assert tracker.update(black).state == "occluded"
    tracker.set_parameters(values)
    assert tracker.estimate.box == tuple(couple.first[0])
    assert tracker.update(black).state == "occluded"
    assert learned_cues(tracker) >= {"hog"}
    seen = tracker.update(couple.images[0])
    assert seen.state == "tracking"
    assert seen.box == pytest.approx(couple.first[0], abs=6)


def test_a_background_model_begins_and_ends_with_the_cues_that_read_it(make_tracker, couple):
    tracker = make_tracker("li2007")
    more = {
        "foreground.weight": 0.5,
        "cues": ("color_histogram", "gradient_orientation", "foreground"),
    }
    states = []
    for index, parameters in enumerate(
        ({}, more, more | {"foreground.weight": 0.0}, more), start=1
    ):
        tracker.set_parameters(parameters)
        tracker.update(couple.images[index], INTERVAL)
        states.append(str(tracker.estimate.background))
    assert states == ["None", "learning", "None", "learning"]
