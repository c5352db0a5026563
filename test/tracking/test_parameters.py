"""The tracker's parameters: which there are, what became of others, and changes."""

import re

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
from pf_tracker_ros.parameters import ParameterError, build, declarations, flatten
from pf_tracker_ros.tracking.hiding import WHILE_HIDDEN
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters
from pf_tracker_ros.tracking.scene import Scene

INTERVAL = 0.04
EVERY = declarations(TrackerParameters)
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def box(boxes, index):
    return tuple(boxes[index].tolist())


# Which there are


@every_preset
def test_every_preset_builds_and_has_its_values(preset):
    values = preset_parameters(preset)
    assert PRESETS[preset].items() <= values.items()
    others = values.keys() - PRESETS[preset].keys()
    assert all(values[name] == EVERY[name].default for name in others)
    assert list(values) == list(EVERY)
    assert flatten(build(TrackerParameters, values)) == values
    assert Tracker.from_preset(preset).parameters == values


def test_what_is_registered_can_be_chosen():
    assert EVERY["cues"].choices == tuple(CUES)
    assert EVERY["motion.model"].choices == tuple(MOTION_MODELS)
    assert EVERY["resampling.scheme"].choices == tuple(RESAMPLERS)
    assert EVERY["track.while_hidden"].choices == tuple(WHILE_HIDDEN)


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
    "hog.power": ("cues", ("hog",)),
    "foreground_color_histogram.keep": ("cues", ("foreground_color_histogram",)),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_parameter_of_a_part_counts_while_the_part_is_chosen(name):
    assert EVERY[name].condition == CONDITIONS[name]
    if CONDITIONS[name]:
        assert EVERY[name].description.endswith("'.")
        assert f" Counts while '{CONDITIONS[name][0]}' " in EVERY[name].description


@every_preset
def test_a_value_of_a_part_that_is_not_chosen_changes_nothing(preset, couple, other_values):
    values = preset_parameters(preset)
    idle = {name: one for name, one in EVERY.items() if not one.counts(values)}
    assert idle
    changes = {name: other_values(one, values[name])[0] for name, one in idle.items()}
    tracker = Tracker.from_preset(preset)
    others = [Tracker.from_preset(preset, parameters=changes), Tracker.from_preset(preset)]
    for one in (tracker, *others):
        one.start(couple.images[0], box(couple.first, 0))
    # Also what is fixed while a target is tracked.
    others[1].set_parameters(changes)
    assert others[0].parameters == others[1].parameters == values | changes
    for image in couple.images[1:6]:
        estimate = tracker.update(image)
        for other in others:
            found = other.update(image)
            assert found.box == estimate.box
            np.testing.assert_array_equal(found.weights, estimate.weights)


def test_a_part_that_is_chosen_has_the_values_that_were_set_before(couple):
    values = {"motion.size_noise": 0.7, "motion.aspect_noise": 0.2, "hog.sharpness": 90.0}
    choice = {"motion.model": "second_order_autoregressive", "cues": ("hog",)}
    tracker = Tracker.from_preset("li2007", seed=3, parameters=values)
    tracker.set_parameters(choice)
    other = Tracker.from_preset("li2007", seed=3, parameters=values | choice)
    for one in (tracker, other):
        one.start(couple.images[0], box(couple.first, 0))
    for image in couple.images[1:4]:
        assert tracker.update(image).box == other.update(image).box


def test_a_single_cue_has_all_of_the_power(couple):
    for power in (0.01, 0.5, 1.0):
        tracker = Tracker.from_preset("zhang2015", parameters={"hog.power": power})
        assert dict(tracker.start(couple.images[0], box(couple.first, 0)).powers) == {"hog": 1.0}
    with pytest.raises(ParameterError, match=r"all cues are off; .* 'hog\.power' must be above 0"):
        Tracker.from_preset("zhang2015", parameters={"hog.power": 0.0})


# Changes under way


@pytest.fixture
def make_scene(make_follower, couple):
    """A scene with the first target in the first image."""

    def make(preset, parameters=None):
        scene = Scene(make_follower(preset, parameters), seed=5)
        scene.start(couple.images[0], box(couple.first, 0))
        return scene

    return make


def learned(scene):
    return {*scene.targets[1].templates}


def test_a_cue_that_is_added_learns_from_the_next_frame_that_is_trusted(
    make_scene, make_follower, couple
):
    never = {"template.update_above": 1.0}
    more = {"cues": ("color_histogram", "gradient_orientation", "hog")}
    scene = make_scene("li2007", never)
    scene.reconfigure(make_follower("li2007", never | more))
    for image in couple.images[1:4]:
        scene.update(image, INTERVAL)
        assert learned(scene) == {"color_histogram", "gradient_orientation"}
        assert scene.targets[1].estimate.powers.keys() == {*more["cues"]}
    scene.reconfigure(make_follower("li2007", more))
    scene.update(couple.images[4], INTERVAL)
    assert learned(scene) == {*more["cues"]}
    # It says something of the next frame: without it the weights are others.
    other = make_scene("li2007")
    for image in couple.images[1:5]:
        other.update(image, INTERVAL)
    for one in (scene, other):
        one.update(couple.images[5], INTERVAL)
    weights = [one.targets[1].estimate.weights for one in (scene, other)]
    assert not np.allclose(*weights)


def test_a_cue_that_has_no_template_yet_says_nothing(make_scene, make_follower, couple):
    never = {"template.update_above": 1.0}
    alone, joined = (make_scene("li2007", never) for _ in range(2))
    # The two that are known keep their proportion, and so much of the sum.
    joined.reconfigure(
        make_follower(
            "li2007",
            never | {"cues": ("color_histogram", "gradient_orientation", "hog"), "hog.power": 1.0},
        )
    )
    sharper = {"color_histogram.sharpness": 10.0, "gradient_orientation.sharpness": 15.0}
    alone.reconfigure(make_follower("li2007", never | sharper))
    for scene in (alone, joined):
        scene.update(couple.images[1], INTERVAL)
    np.testing.assert_allclose(
        joined.targets[1].estimate.weights, alone.targets[1].estimate.weights
    )
    assert joined.targets[1].estimate.confidence == alone.targets[1].estimate.confidence


def test_a_cue_that_is_removed_is_forgotten_at_once(make_scene, make_follower, couple):
    """Else the template of one window would be compared in another."""
    never = {"template.update_above": 1.0, "template.confident_above": 0.0}
    scene = make_scene("default", never)
    assert learned(scene) == {"color_contrast", "correlation_response"}
    scene.reconfigure(make_follower("default", never | {"cues": ("color_contrast",)}))
    assert learned(scene) == {"color_contrast"}
    assert scene.targets[1].distraction.keys() == {"color_contrast"}
    scene.reconfigure(make_follower("default", never | {"correlation_response.window": 6.0}))
    scene.update(couple.images[1], INTERVAL)
    assert learned(scene) == {"color_contrast"}
    scene.reconfigure(make_follower("default", {"correlation_response.window": 6.0}))
    scene.update(couple.images[2], INTERVAL)
    assert learned(scene) == {"color_contrast", "correlation_response"}


def test_a_tracker_takes_a_cue_leaves_one_out_and_changes_powers(couple):
    tracker = Tracker.from_preset("default")
    tracker.start(couple.images[0], couple.second[0])
    changes = {
        1: ({"cues": ("color_contrast", "correlation_response", "hog"), "hog.power": 1.0}, None),
        4: ({"hog.power": 0.5}, None),
        7: ({"cues": ("correlation_response", "hog")}, None),
        10: ({"hog.power": 0.0}, {"correlation_response": 1.0}),
        13: ({"cues": ("correlation_response", "color_contrast")}, None),
        16: ({"cues": ("color_contrast",)}, {"color_contrast": 1.0}),
    }
    for index in range(1, len(couple.images)):
        values, powers = changes.get(index, ({}, None))
        if values:
            tracker.set_parameters(values)
            assert values.items() <= tracker.parameters.items()
        estimate = tracker.update(couple.images[index])
        assert estimate.box == pytest.approx(couple.second[index], abs=8)
        now = tracker.parameters
        used = [name for name in now["cues"] if now[f"{name}.power"]]
        assert estimate.powers.keys() == {*used}
        if powers:
            assert dict(estimate.powers) == powers


@pytest.mark.parametrize(
    "values",
    [
        {"cues": ("hog",)},
        {"cues": ("hog", "color_contrast", "foreground")},
        {"cues": ("hog", "color_histogram"), "color_histogram.power": 0.0},
    ],
)
def test_one_of_the_cues_must_have_learned_the_target(values, couple):
    """Else whatever hides it would be taken for it."""
    tracker = Tracker.from_preset("li2007")
    tracker.start(couple.images[0], couple.first[0])
    before = tracker.parameters
    reason = "no cue in 'cues' has learned the target .*; keep one .*, or stop first"
    for _ in range(2):
        with pytest.raises(ParameterError, match=reason):
            tracker.set_parameters(values)
        assert tracker.parameters == before
        # Once it is in use it still has to learn, and nothing is to be learned from here.
        tracker.set_parameters({"cues": ("color_histogram", "gradient_orientation", "hog")})
        assert tracker.update(np.zeros_like(couple.images[0])).state == "occluded"
        before = tracker.parameters
    tracker.stop()
    tracker.set_parameters(values)


def test_a_background_model_begins_and_ends_with_the_cues_that_read_it(
    make_scene, make_follower, couple
):
    scene = make_scene("li2007")
    more = {"cues": ("color_histogram", "gradient_orientation", "foreground")}
    told = []
    for index, parameters in enumerate(({}, more, more | {"foreground.power": 0.0}, more), start=1):
        scene.reconfigure(make_follower("li2007", parameters))
        scene.update(couple.images[index], INTERVAL)
        told.append(scene.targets[1].estimate.background)
    assert [str(one) for one in told] == ["None", "learning", "None", "learning"]
