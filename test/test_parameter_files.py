"""Tracker settings of a ROS parameter file."""

import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.parameter_files import TrackerSettings, read_parameter_file, section_lines
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

TUNED = """\
"/left/pf_tracker":
  ros__parameters:
    preset: zhang2015
    seed: 4
    max_targets: 1
    click_size: 30.0
    target_box: [1.0, 2.0, 30.0, 40.0]
    use_sim_time: true
    qos_overrides: {/image: {subscription: {depth: 3}}}
    particles: 50
    resampling: {threshold: 0.25}
    cues: [hog, color_histogram]
"""


@pytest.fixture
def file(tmp_path):
    """Writes a parameter file."""

    def write(text):
        path = tmp_path / "own.yaml"
        path.write_text(text)
        return path

    return write


def test_parameters_of_the_tracker_are_read_without_those_of_the_node(file):
    settings = read_parameter_file(file(TUNED))
    values = {"max_targets": 1, "particles": 50, "resampling.threshold": 0.25}
    values["cues"] = ("hog", "color_histogram")
    assert settings == TrackerSettings("zhang2015", 4, values)
    # The library accepts them.
    tracker = Tracker.from_preset(settings.preset, settings.seed, settings.parameters)
    assert {name: tracker.parameters[name] for name in values} == values


@pytest.mark.parametrize(
    ("text", "parameters"),
    [
        ("any_name:\n  ros__parameters: {particles: 7}\n", {"particles": 7}),
        (
            "/**:\n  ros__parameters: {particles: 7, cues: [hog]}\n"
            "left:\n  pf_tracker:\n    ros__parameters: {particles: 8}\n"
            "/left/camera:\n  ros__parameters: {rate: 30}\n",
            {"particles": 8, "cues": ("hog",)},
        ),
        ("/*:\n  ros__parameters: {}\n/a:\n  ros__parameters: {particles: 7}\n", {}),
        ("pf_tracker:\n  ros__parameters:\n", {}),
    ],
)
def test_the_sections_of_a_tracker_are_merged(file, text, parameters):
    assert read_parameter_file(file(text)).parameters == parameters


@pytest.mark.parametrize("preset", PRESETS)
def test_every_value_of_a_preset_comes_back(file, preset):
    values = preset_parameters(preset) | {"motion.position_noise": 1e-05}
    lines = section_lines("/left/pf_tracker", {"preset": preset} | values)
    settings = read_parameter_file(file("\n".join(lines)))
    assert (settings.preset, settings.parameters) == (preset, values)
    assert values.keys() <= declarations(TrackerParameters).keys()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "own.yaml cannot be read as YAML"),
        ("- 1", "own.yaml is no ROS parameter file: it has no ros__parameters"),
        ("particles: 5", "own.yaml is no ROS parameter file: it has no ros__parameters"),
        (
            "/a:\n  ros__parameters: {x: 1}\n/n/b:\n  ros__parameters: {x: 1}\n",
            "own.yaml has parameters of /a, /n/b; allowed: of pf_tracker",
        ),
        ("/**:\n  ros__parameters: {preset: best}\n", "own.yaml: parameter 'preset' is 'best'"),
        ("/**:\n  ros__parameters: {seed: -1}\n", "own.yaml: parameter 'seed' is -1"),
        ("/**:\n  ros__parameters: {target_box: [1]}\n", "own.yaml: parameter 'target_box' is"),
    ],
)
def test_a_file_without_parameters_of_a_tracker_is_refused(file, text, message):
    with pytest.raises(ParameterError, match=r"own\.yaml") as error:
        read_parameter_file(file(text))
    assert message in str(error.value)


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="No such file"):
        read_parameter_file(tmp_path / "none.yaml")
    with pytest.raises(ParameterError, match="is a folder"):
        read_parameter_file(tmp_path)
