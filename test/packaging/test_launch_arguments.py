"""The launch files with stand-ins for launch and launch_ros, which PyPI has not."""

import importlib
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
FILES = ("detector", "follow", "replay", "tracker")
MODULES = ["launch", "launch_ros", "ament_index_python", "ament_index_python.packages"]
MODULES += [f"launch.{name}" for name in ("actions", "event_handlers", "substitutions")]
MODULES += ["launch.launch_description_sources", "launch_ros.actions"]
MODULES += ["launch_ros.parameter_descriptions"]
# Executable to its parameters.
KNOWN = {
    "tracker": declarations(NodeParameters) | declarations(TrackerParameters),
    "localizer": declarations(LocalizerParameters),
    "replay": declarations(ReplayParameters),
    "console": declarations(ConsoleParameters),
}
# Each argument that is none of these, with a value other than its default.
GIVEN = {
    **{"preset": "li2007", "image_reliability": "reliable", "image_transport": "compressed"},
    **{"seed": "3", "max_targets": "5", "built_in_detector": "people", "score_above": "0.4"},
    **{"built_in_detector_rate": "2.0", "labels": "[person, 'car']", "console_port": "8700"},
    **{"target_box": "[1, 2, 30, 40]", "console": "TRUE", "method": "height", "rate": "2"},
    **{"fixed_frame": "map", "depth_transport": "compressed", "bag_topic": "/eye", "loop": "1"},
    **dict.fromkeys(("camera_height", "target_height"), "1.5"),
    **dict.fromkeys(("camera_pitch", "camera_roll", "target_height_sd"), "0.1"),
    **dict.fromkeys(("depth_tolerance", "min_confidence", "coast", "hold"), "0.1"),
}


class Action:
    """Any action, substitution or description: what it is made of."""

    def __init__(self, *given, **named):
        self.given, self.named = given, named

    def perform(self, context):
        """The value of a `LaunchConfiguration`."""
        context.read.add(self.given[0])
        return context.values[self.given[0]]


class StandIn(ModuleType):
    """A module in which every name is an action, but two functions."""

    def __getattr__(self, name):
        functions = {"ParameterValue": lambda value, value_type: value}
        return {**functions, "get_package_share_directory": str}.get(name, Action)


@pytest.fixture
def launched(monkeypatch):
    """Runs a launch file with arguments; what it declares, reads and makes."""
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, StandIn(name))
    sys.modules.pop("pf_tracker_ros.launching", None)

    def start(name, **values):
        spec = spec_from_file_location(name, LAUNCH / f"{name}.launch.py")
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        *declared, opaque = module.generate_launch_description().given[0]
        defaults = {one.given[0]: one.named.get("default_value", "") for one in declared}
        context = SimpleNamespace(read=set(), values=defaults | values)
        made = opaque.named["function"](context)
        return SimpleNamespace(declared=declared, names={*defaults}, read=context.read, made=made)

    yield start
    sys.modules.pop("pf_tracker_ros.launching", None)


# Where a parameter has another name than the argument.
RENAMED = {"labels": "detector.labels", "score_above": "detector.score_above"}
RENAMED |= {"console_port": "port", "console": "use_sim_time"}


@pytest.mark.parametrize("name", FILES)
def test_every_argument_is_described_and_read_and_sets_an_allowed_parameter(launched, name):
    plain = launched(name, console="true")
    assert plain.read == plain.names
    assert all(one.named["description"].endswith(".") for one in plain.declared)
    given = {one: value for one, value in GIVEN.items() if one in plain.names}
    parameters = {}
    for node in launched(name, **given).made:
        known = KNOWN.get(node.named.get("executable"), {})
        for parameter, value in node.named["parameters"][-1].items() if known else ():
            parameters[parameter] = value
            if parameter != "use_sim_time":
                known[parameter].validate(value)
                assert type(value) is list or type(value) is known[parameter].type
    # A replay hands those of its tracker on.
    of_node = given if name != "replay" else ("bag_topic", "rate", "loop", "target_box")
    dotted = {one: one.replace("_", ".", 1) for one in given if one.startswith("camera_")}
    missing = {one: dotted.get(one, RENAMED.get(one, one)) for one in of_node}
    known = {*parameters, *(one.replace(".", "_") for one in parameters)}
    assert {one for one, parameter in missing.items() if parameter not in known} == set()


def test_the_replay_publisher_hands_the_tracker_only_arguments_that_it_has(launched):
    _, group, replay = launched("replay", target_box="1, 2, 30, 40", loop="yes").made
    handed = dict(group.given[0][0].named["launch_arguments"])
    assert handed.keys() == launched("tracker").names
    (parameters,) = replay.named["parameters"]
    assert (parameters["target_box"], parameters["loop"]) == ([1.0, 2.0, 30.0, 40.0], True)
    assert len(launched("replay", tracker="0").made) == 1


def test_shared_arguments_are_declared_by_several_files_and_large_images_by_a_profile(launched):
    named = [launched(name).names for name in FILES]
    shared = importlib.import_module("pf_tracker_ros.launching")._SHARED
    assert [one for one in shared if sum(one in names for names in named) < 2] == []
    (tracker,) = launched("tracker", large_images="True", autostart="no", log_level="warn").made
    assert "fastdds_large_images.xml" in str(tracker.named["additional_env"])
    assert tracker.named["arguments"] == ["--ros-args", "--log-level", "warn"]
    assert tracker.named["parameters"] == [{"use_sim_time": False, "autostart": False}]


@pytest.mark.parametrize(
    ("name", "argument", "value", "allowed"),
    [
        ("tracker", "use_sim_time", "perhaps", "true or false"),
        ("tracker", "console", "perhaps", "true or false"),
        ("tracker", "seed", "some", "int, 0 to 2147483647"),
        ("tracker", "seed", "-5", "int, 0 to 2147483647"),
        ("tracker", "log_level", "loud", "debug, info"),
        ("tracker", "console_port", "web", "int, 0 to 65535"),
        ("tracker", "console_port", "99999", "int, 0 to 65535"),
        ("tracker", "target_box", "[1,2]", "[x, y, width, height]"),
        ("tracker", "target_box", "[1,2,-3,4]", "[x, y, width, height] in pixels, width and"),
        ("tracker", "image_transport", "jpeg", "raw, compressed"),
        ("tracker", "params_file", "none.yaml", ""),
        ("tracker", "preset", "lee2007", "default, "),
        ("detector", "max_targets", "many", "int, 1 to 1000"),
        ("detector", "max_targets", "0", "int, 1 to 1000"),
        ("detector", "score_above", "7", "float, 0 to 1"),
        ("detector", "built_in_detector", "cars", "none, people, motion"),
        ("follow", "camera_height", "tall", "float, 0 to 1000"),
        ("follow", "camera_height", "-1", "float, 0 to 1000"),
        ("follow", "method", "radar", "auto, ground, height, depth"),
        ("follow", "rectified", "perhaps", "true or false"),
        ("replay", "rate", "0", "float, "),
    ],
)
def test_a_wrong_argument_is_refused_with_what_is_allowed(launched, name, argument, value, allowed):
    console = {"console": "true"} if argument == "console_port" else {}
    told = f"allowed: {allowed}" if allowed else "the file does not exist"
    with pytest.raises(ValueError, match=re.escape(f"argument {argument}:={value}; {told}")):
        launched(name, **console, **{argument: value})
