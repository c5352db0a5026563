"""A cue is one new file: `cues/brightness.py`, here of another package."""

import json

import numpy as np
import pytest

from pf_tracker_ros.cues import CUES
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

CUES_CHOSEN = ("color_histogram", "gradient_orientation", "brightness")


def test_its_parameters_are_active_with_the_file_alone(extended):
    code = f"""
every = declarations(TrackerParameters)
own = [one for name, one in every.items() if name.startswith("brightness.")]
chosen = {{"cues": {CUES_CHOSEN}, "brightness.sharpness": 11.0}}
print(json.dumps({{
    "own": [(one.name, one.condition) for one in own],
    "wrong": refusal(Tracker.from_preset, "li2007", parameters=chosen),
}}))
"""
    result = extended(code)
    names = [f"brightness.{name}" for name in ("weight", "sharpness", "keep")]
    assert result["own"] == [[name, ["cues", ["brightness"]]] for name in names]
    wrong = "parameter 'brightness.sharpness' is 11.0; allowed: float, 0 to 10"
    assert result["wrong"].startswith(wrong)
    assert "brightness" not in CUES


def test_it_is_switched_on_off_and_tuned_while_tracking(extended):
    code = f"""
tracker = Tracker.from_preset("li2007")
tracker.start(images[0], boxes[0])
changes = {{
    4: {{"cues": {CUES_CHOSEN}}},
    8: {{"brightness.sharpness": 1.0, "brightness.weight": 1.0}},
    12: {{"cues": ("color_histogram",)}},
}}
found, cue_weights = [], []
for number, image in enumerate(images[1:]):
    if number in changes:
        tracker.set_parameters(changes[number])
    estimate = tracker.update(image)
    found.append(estimate.box)
    cue_weights.append(estimate.cue_weights.get("brightness"))
print(json.dumps([least_overlap(found), cue_weights]))
"""
    least, cue_weights = extended(code)
    assert least > 0.4
    shares = [None] * 4 + [0.2 / 1.2] * 4 + [1.0 / 2.0] * 4 + [None] * 7
    assert cue_weights == pytest.approx(shares)


def test_the_presets_are_as_without_it(extended):
    found = extended("print(json.dumps({name: preset_parameters(name) for name in PRESETS}))")
    shipped = json.loads(json.dumps({name: preset_parameters(name) for name in PRESETS}))
    assert {
        name: {key: value for key, value in values.items() if key in shipped[name]}
        for name, values in found.items()
    } == shipped


def test_the_cue_by_hand(extended):
    """With boxes that extend outside the image."""
    code = """
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.frames import Frame, Region

image = np.full((60, 80), 100, np.uint8)
image[20:40, 30:50] = 150
image[:, :5] = 30
boxes = np.array([
    [30.0, 20.0, 20.0, 20.0], [40.0, 20.0, 20.0, 20.0], [-5.0, 10.0, 20.0, 20.0],
    [70.0, 50.0, 20.0, 20.0],
])
parameters = CUES.parameters_of("brightness")(sharpness=0.5, keep=0.75)
cue, region = CUES["brightness"](parameters), Region(Frame(image), boxes)
template = cue.learn(region, boxes[0])
print(json.dumps({
    "learned": [cue.learn(region, box) for box in boxes],
    "log_likelihood": cue.log_likelihood(region, boxes, template).tolist(),
    "match": cue.match(cue.learn(region, boxes[1]), template),
    "blended": cue.blend(template, 110.0),
}))
"""
    result = extended(code)
    means = np.array([150.0, 125.0, (30 * 5 + 100 * 10) / 15, 100.0])
    np.testing.assert_allclose(result["learned"], means)
    np.testing.assert_allclose(result["log_likelihood"], -0.5 * (150.0 - means))
    assert result["match"] == pytest.approx([-12.5, 1 - 25 / 255])
    assert result["blended"] == pytest.approx(140.0)
