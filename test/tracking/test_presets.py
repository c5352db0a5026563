"""Differences from a preset."""

import pytest

from pf_tracker_ros.parameters import build, flatten
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, ActivePreset, preset_parameters


def active_preset(preset, changes):
    values = preset_parameters(preset) | changes
    values = flatten(build(TrackerParameters, values))
    return ActivePreset.of({"preset": preset, "image_topic": "image", **values})


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_differs_in_nothing_from_itself(preset):
    assert active_preset(preset, {}).description == active_preset(preset, {}).summary == preset


def test_the_description_lists_changes_with_the_values_of_the_preset():
    preset = active_preset("li2007", {"particles": 80, "template.update_above": 0.5})
    assert preset.changes == {"particles": (80, 60), "template.update_above": (0.5, 0.2)}
    assert preset.summary == "li2007, 2 values changed"
    assert preset.description == (
        "li2007, 2 values changed: particles 80 instead of 60, "
        "template.update_above 0.5 instead of 0.2"
    )


def test_parts_that_the_preset_does_not_select_are_compared_with_their_defaults():
    cues = ("hog", "color_contrast")
    values = {"cues": cues, "hog.weight": 0.3, "hog.sharpness": 300.0}
    preset = active_preset("default", values)
    before = ("color_contrast", "correlation_response")
    assert preset.changes == {"cues": (cues, before), "hog.weight": (0.3, 0.5)}
    assert preset.summary == "default, 2 values changed"
