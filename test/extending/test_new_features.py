"""Features of the correlation filter are one new file: `features/cell_means.py`."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

NAME = "correlation_response.features"


def test_without_the_file_there_is_nothing_to_choose_from():
    assert list(FEATURES) == ["gradients_and_colors"]
    assert NAME not in declarations(TrackerParameters)
    assert NAME not in preset_parameters("default")
    for value in FEATURES:
        with pytest.raises(ParameterError, match=f"no parameter '{NAME}'"):
            Tracker.from_preset("default", parameters={NAME: value})


def test_with_the_file_they_are_chosen_by_a_parameter(extended):
    code = f"""
declaration = declarations(TrackerParameters)["{NAME}"]
print(json.dumps({{
    "choices": declaration.choices,
    "default": declaration.default,
    "read_only": declaration.read_only,
    "condition": declaration.condition,
    "preset": preset_parameters("default")["{NAME}"],
    "wrong": refusal(Tracker.from_preset, "default", parameters={{"{NAME}": "cell_medians"}}),
}}))
"""
    result = extended(code)
    assert sorted(result["choices"]) == ["cell_means", "gradients_and_colors"]
    assert result["default"] == result["preset"] == "gradients_and_colors"
    assert result["read_only"]
    assert result["condition"] == ["cues", ["correlation_response"]]
    assert result["wrong"].startswith(f"parameter '{NAME}' is 'cell_medians'; allowed: string, ")


def test_windows_have_the_resolution_of_the_features(extended):
    """40 cells of 8 pixels; three colors or one gray level, and two edges."""
    code = """
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.frames import Frame, Region

FEATURES.parameters_of("cell_means")
from parts_of_mine.cell_means import CellMeans

shapes = []
extract = CellMeans.extract
def recording(self, windows):
    shapes.append(windows.shape)
    return extract(self, windows)
CellMeans.extract = recording

parameters = CUES.parameters_of("correlation_response")(features="cell_means")
cue = CUES["correlation_response"](parameters)
colored = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
box = np.array([140.0, 100.0, 40.0, 32.0])
templates = [
    cue.learn(Region(Frame(image), box[None]), box)
    for image in (colored, np.ascontiguousarray(colored[..., 1]))
]
print(json.dumps([shapes, [template.filter.shape for template in templates]]))
"""
    shapes, filters = extended(code)
    assert shapes == [[1, 320, 320, 3], [1, 320, 320]]
    assert filters == [[5, 40, 21], [3, 40, 21]]


def test_the_channels_by_hand(extended):
    """Means of 8 x 8 pixels; a horizontal ramp has only a horizontal gradient."""
    code = """
from pf_tracker_ros.cues.features import FEATURES

window = np.random.default_rng(0).integers(0, 256, (24, 24, 3), dtype=np.uint8)
ramp = np.tile((2 * np.arange(24)).astype(np.uint8), (24, 1))
features = FEATURES.make("cell_means", FEATURES.parameters_of("cell_means")())
print(json.dumps([
    window.tolist(), features.extract(window[None])[0].tolist(),
    features.extract(ramp[None])[0].tolist(),
]))
"""
    window, channels, of_ramp = (np.array(each) for each in extended(code))
    means = window.reshape(3, 8, 3, 8, 3).mean(axis=(1, 3)).transpose(2, 0, 1)
    np.testing.assert_allclose(channels[:3], means, rtol=1e-5)
    assert of_ramp.shape == (3, 3, 3)
    assert (of_ramp[1] > 0).all()
    np.testing.assert_array_equal(of_ramp[2], 0.0)
