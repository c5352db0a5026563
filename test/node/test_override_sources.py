"""A preset that is given beside a file, or in a later one, is taken whole."""

import pytest
from rclpy.parameter import parameter_value_to_python

from pf_tracker_ros.node.override_sources import given_before
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

OWN = """\
/**:
  ros__parameters:
    preset: default
    particles: 77
    motion:
      position_noise: 0.9
    click_size: 12.0
"""
OTHERS = """\
/left/pf_tracker:
  ros__parameters: {preset: li2007, particles: 88}
right:
  pf_tracker:
    ros__parameters: {preset: zhang2015}
/*/other:
  ros__parameters: {preset: zhang_bo}
"""
OWN_NAMES = {"particles", "motion.position_noise", "click_size"}


@pytest.fixture
def files(tmp_path):
    paths = {}
    for name, text in {"own": OWN, "others": OTHERS, "broken": "a: [", "list": "- 1"}.items():
        path = tmp_path / f"{name}.yaml"
        path.write_text(text)
        paths[name] = str(path)
    return paths


@pytest.mark.parametrize(
    ("node", "arguments", "before"),
    [
        ("/pf_tracker", "--params-file {own}", set()),
        ("/pf_tracker", "--params-file {own} -p preset:=li2007", OWN_NAMES),
        ("/pf_tracker", "-p preset:=li2007 --params-file {own}", OWN_NAMES),
        (
            "/pf_tracker",
            "--params-file {own} -p preset:=li2007 --param particles:=5",
            OWN_NAMES - {"particles"},
        ),
        ("/pf_tracker", "--params-file {own} -p particles:=5", set()),
        ("/pf_tracker", "--params-file {own} --params-file {others}", set()),
        (
            "/left/pf_tracker",
            "--params-file {own} --params-file {others}",
            OWN_NAMES - {"particles"},
        ),
        ("/right/pf_tracker", "--params-file {own} --params-file {others}", OWN_NAMES),
        ("/pf_tracker", "--params-file {own} -p pf_tracker:preset:=li2007", OWN_NAMES),
        ("/pf_tracker", "--params-file {own} -p camera:preset:=li2007", set()),
        ("/pf_tracker", "--params-file {own} -- -p preset:=li2007", set()),
        ("/pf_tracker", "--params-file {broken} --params-file {list} -p preset:=li2007", set()),
        ("/pf_tracker", "--params-file /nowhere -p preset:=li2007 -p", set()),
    ],
)
def test_what_was_given_before_the_preset_is_known(files, node, arguments, before):
    command_line = ["tracker", "--ros-args", *arguments.format(**files).split()]
    assert given_before("preset", node, command_line) == before


def test_what_is_not_for_ros_is_left_alone(files):
    command_line = ["tracker", "--params-file", files["own"], "-p", "preset:=li2007"]
    assert given_before("preset", "/pf_tracker", command_line) == set()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("--params-file {own}", ("default", {"particles": 77, "motion.position_noise": 0.9})),
        ("--params-file {own} -p preset:=li2007", ("li2007", {})),
        ("--params-file {own} -p preset:=li2007 -p particles:=5", ("li2007", {"particles": 5})),
    ],
)
def test_a_process_takes_the_preset_of_its_command_line_whole(
    graph, files, images, arguments, expected
):
    preset, changes = expected
    client = graph.client()
    reliable = ["-p", "image_reliability:=reliable"]
    graph.process(*arguments.format(**files).split(), *reliable)
    client.meet()
    names = [*declarations(TrackerParameters), "click_size"]
    response = client.call(client.parameters.get_parameters, names)
    values = dict(zip(names, map(parameter_value_to_python, response.values), strict=True))
    # What no preset has a value for comes from the file in any case.
    assert values == preset_parameters(preset) | changes | {"click_size": 12.0}
    count = {0: "", 1: ", 1 value changed", 2: ", 2 values changed"}[len(changes)]
    assert client.show(images[0], client.at(0)).values["preset"] == preset + count
