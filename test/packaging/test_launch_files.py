"""The launch files compile, use the arguments that they declare, and set parameters that exist."""

import ast
import importlib.util
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
LAUNCH_FILES = sorted((REPOSITORY / "launch").glob("*.launch.py"))
# Those that declare an argument, and those that read one.
DECLARING = ("DeclareLaunchArgument", "flag")
READING = ("given", "LaunchConfiguration")

each_launch_file = pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)


def parsed(path):
    tree = ast.parse(path.read_text())
    compile(tree, str(path), "exec")
    return tree


def first_arguments(tree, functions):
    """The literal first arguments of all calls of some functions."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args]
    return {
        call.args[0].value
        for call in calls
        if getattr(call.func, "id", "") in functions and isinstance(call.args[0], ast.Constant)
    }


def constants(tree):
    """The values of the constants of a module that are written out."""
    return {
        statement.targets[0].id: ast.literal_eval(statement.value)
        for statement in tree.body
        if isinstance(statement, ast.Assign)
    }


def parameters_set(tree):
    """Names of the node's parameters that a launch file sets."""
    subscripts = [node for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    named = {
        node.slice.value
        for node in subscripts
        if getattr(node.value, "id", "") == "parameters" and isinstance(node.slice, ast.Constant)
    }
    values = constants(tree)
    return named | {*values.get("TEXTS", ()), *values.get("FLAGS", ())}


def test_there_are_launch_files_for_the_tracker_and_the_replay_publisher():
    assert [path.name for path in LAUNCH_FILES] == ["replay.launch.py", "tracker.launch.py"]


@each_launch_file
def test_each_argument_that_is_read_is_declared_and_each_declared_one_is_read(path):
    tree = parsed(path)
    values = constants(tree)
    read = first_arguments(tree, READING) | {*values["TEXTS"], *values.get("FLAGS", ())}
    assert read == first_arguments(tree, DECLARING)


def test_the_replay_publisher_hands_the_tracker_only_arguments_that_it_has():
    replay, tracker = map(parsed, LAUNCH_FILES)
    (handed,) = [
        keyword.value.func.value
        for node in ast.walk(replay)
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "launch_arguments"
    ]
    assert {key.value for key in handed.keys} == first_arguments(tracker, DECLARING)


def test_the_parameters_that_are_set_exist_and_have_the_type_that_is_given():
    pytest.importorskip("rclpy")
    from pf_tracker_ros.node.node_parameters import NodeParameters
    from pf_tracker_ros.node.replay_parameters import ReplayParameters
    from pf_tracker_ros.parameters import declarations

    for path, group in zip(LAUNCH_FILES, (ReplayParameters, NodeParameters), strict=True):
        known = declarations(group)
        tree = parsed(path)
        assert parameters_set(tree) - {"use_sim_time"} <= known.keys()
        values = constants(tree)
        assert all(known[name].type is str for name in values["TEXTS"])
        assert all(known[name].type is bool for name in values.get("FLAGS", ()))


@each_launch_file
def test_the_launch_description_declares_the_arguments(path):
    pytest.importorskip("launch_ros")
    specification = importlib.util.spec_from_file_location(path.stem.replace(".", "_"), path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    arguments = module.generate_launch_description().get_launch_arguments()
    assert {argument.name for argument in arguments} == first_arguments(parsed(path), DECLARING)
    assert all(argument.description for argument in arguments)
