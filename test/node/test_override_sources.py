"""A preset replaces the values of earlier parameter files."""

import os
import signal

import pytest

from pf_tracker_ros.node.override_sources import parameters_superseded_by, unmatched_file_warnings
from pf_tracker_ros.tracking.presets import preset_parameters

OWN = """\
/**:
  ros__parameters:
    preset: default
    particles: 77
    motion:
      position_noise: 0.9
    click_size: 12.0
    wings: 2
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
MORE = """\
/**:
  ros__parameters: {motion.position_noise: 0.8, click_size: 9.0}
"""
OTHER_NAMES = {"motion.position_noise", "click_size", "wings"}
OWN_NAMES = {"particles", *OTHER_NAMES}


@pytest.fixture
def files(tmp_path):
    paths = {}
    texts = {"own": OWN, "others": OTHERS, "more": MORE, "broken": "a: [", "list": "- 1"}
    for name, text in texts.items():
        path = tmp_path / f"{name}.yaml"
        path.write_text(text)
        paths[name] = str(path)
    return paths


@pytest.mark.parametrize(
    ("node", "arguments", "before"),
    [
        ("/pf_tracker", "--params-file {own}", set()),
        ("/pf_tracker", "--params-file {own} -p preset:=li2007", OWN_NAMES),
        ("/pf_tracker", "-p preset:=li2007 --params-file {own}", set()),
        (
            "/pf_tracker",
            "--params-file {own} -p preset:=li2007 --params-file {more}",
            {"particles", "wings"},
        ),
        ("/pf_tracker", "--params-file {own} -p preset:=li2007 --param particles:=5", OTHER_NAMES),
        ("/pf_tracker", "--params-file {own} --params-file {others}", set()),
        ("/left/pf_tracker", "--params-file {own} --params-file {others}", OTHER_NAMES),
        ("/right/pf_tracker", "--params-file {own} --params-file {others}", OWN_NAMES),
        ("/pf_tracker", "--params-file {own} -p pf_tracker:preset:=li2007", OWN_NAMES),
        ("/pf_tracker", "--params-file {own} -p camera:preset:=li2007", set()),
        ("/left/pf_tracker", "--params-file {own} -p pf_tracker:preset:=li2007", set()),
        ("/left/pf_tracker", "--params-file {own} -p left/pf_tracker:preset:=li2007", OWN_NAMES),
        ("/pf_tracker", "--params-file {own} -- -p preset:=li2007", set()),
        ("/pf_tracker", "--params-file {broken} --params-file {list} -p preset:=li2007", set()),
        ("/pf_tracker", "--params-file /nowhere -p preset:=li2007 -p", set()),
    ],
)
def test_parameters_of_files_before_the_preset_are_superseded(files, node, arguments, before):
    given = arguments.format(**files).split()
    assert parameters_superseded_by("preset", node, ["tracker", "--ros-args", *given]) == before
    assert parameters_superseded_by("preset", node, ["tracker", *given]) == set()


@pytest.mark.parametrize(
    ("node", "warned"),
    [
        ("/pf_tracker", {"others": "/left/pf_tracker and /right/pf_tracker and /*/other"}),
        ("/left/pf_tracker", {}),
        ("/right/other", {}),
        ("/other", {"others": "/left/pf_tracker"}),
    ],
)
def test_a_file_for_other_nodes_is_a_warning(files, node, warned):
    # Each file twice, with one warning.
    given = 2 * [word for path in files.values() for word in ("--params-file", path)]
    warnings = list(unmatched_file_warnings(node, ["tracker", "--ros-args", *given]))
    assert len(warnings) == len(warned)
    for warning, (name, patterns) in zip(warnings, warned.items(), strict=True):
        assert f"{files[name]} has nothing for {node}, only for {patterns}" in warning
    assert list(unmatched_file_warnings(node, ["tracker", *given])) == []


def start(graph, client, arguments):
    """A tracker with the arguments of its command line."""
    given = f"{arguments} -p image_reliability:=reliable"
    return graph.tracker(client, cli_args=["--ros-args", *given.split()])


@pytest.mark.parametrize(
    "case",
    [
        ("--params-file {own}", "default", {"particles": 77, "motion.position_noise": 0.9}),
        ("--params-file {own} -p preset:=li2007", "li2007", {}),
        ("--params-file {own} -p preset:=li2007 -p particles:=5", "li2007", {"particles": 5}),
    ],
)
def test_a_node_applies_the_whole_preset_of_its_command_line(  # noqa: PLR0917
    graph, client, files, images, case, capfd
):
    arguments, preset, changes = case
    start(graph, client, arguments.format(**files))
    assert client.tunables() == preset_parameters(preset) | changes
    # No preset has this parameter: the file's value stays.
    assert client.get_parameters("click_size") == [12.0]
    count = {0: "", 1: ", 1 value changed", 2: ", 2 values changed"}[len(changes)]
    assert client.show(images[0], client.at(0)).values["preset"] == preset + count
    # One that no part has is reported also where the preset supersedes the others.
    assert capfd.readouterr().err.count("no parameter 'wings'") == 1


def test_a_process_warns_of_a_file_for_other_nodes(graph, client, files):
    process = graph.process("--params-file", files["others"])
    client.meet()
    process.send_signal(signal.SIGINT)
    log, _ = process.communicate(timeout=60)
    assert f"{files['others']} has nothing for /pf_tracker, only for /left/pf_tracker" in log


def test_a_pipe_that_rcl_has_read_does_not_block(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    command_line = ["tracker", "--ros-args", "--params-file", str(pipe), "-p", "preset:=li2007"]
    assert parameters_superseded_by("preset", "/pf_tracker", command_line) == set()
