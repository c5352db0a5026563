"""The tracker's parameters as JSON, and back."""

import pytest
import yaml
from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
)
from rclpy.parameter import Parameter, parameter_value_to_python

from pf_tracker_ros.node.console.tuning import (
    parameter_file,
    parameter_from_json,
    parameters_to_json,
    tunable_names,
)


def value(content):
    return Parameter("any", value=content).get_parameter_value()


def described(name, content, **options):
    parameter = Parameter(name, value=content)
    descriptor = ParameterDescriptor(name=name, type=parameter.type_.value, **options)
    return descriptor, parameter.get_parameter_value()


def shape(*parameters):
    descriptors, values = zip(*parameters, strict=True)
    return {one["name"]: one for one in parameters_to_json(descriptors, values)}


def test_names_have_the_order_of_the_documentation_without_common_ones():
    names = ["motion.model", "use_sim_time", "qos_overrides./x", "new.one", "preset", "particles"]
    assert tunable_names(names) == ["preset", "particles", "motion.model", "new.one"]


def test_each_parameter_has_group_range_and_preset_value():
    bounds = FloatingPointRange(from_value=0.0, to_value=50.0)
    found = shape(
        described("preset", "li2007"),
        described("particles", 80),
        described("motion.position_noise", 0.7, floating_point_range=[bounds], description="Walk."),
        described("color_histogram.keep", 0.9),
        described("hog.keep", 0.9),
        described("hostile.<b>", "<script>"),
    )
    assert [one["group"] for one in found.values()] == [
        "The node",
        "The tracker",
        "The tracker",
        "Color histogram",
        "Others",
        "Without effect at present",
    ]
    chosen = shape(described("hog.keep", 0.9), described("cues", ["hog"]))
    assert chosen["hog.keep"]["group"] == "Hog"
    assert found["motion.position_noise"]["range"] == [0.0, 50.0]
    assert (found["particles"]["value"], found["particles"]["default"]) == (80, 60)
    assert found["preset"]["choices"] == ["default", "li2007", "zhang2015", "zhang_bo"]
    assert found["hostile.<b>"]["default"] is None


def test_the_preset_values_depend_on_the_number_of_targets():
    several = shape(
        described("preset", "default"), described("max_targets", 4), described("particles", 100)
    )
    assert several["particles"]["default"] == 100
    single = shape(described("preset", "default"), described("particles", 100))
    assert single["particles"]["default"] == 200


def test_an_empty_list_of_numbers_is_kept():
    descriptor = ParameterDescriptor(name="target_box", type=ParameterType.PARAMETER_DOUBLE_ARRAY)
    (one,) = parameters_to_json([descriptor], [ParameterValue()])
    assert (one["kind"], one["value"], one["default"]) == ("numbers", [], [])


@pytest.mark.parametrize(
    ("kind", "given", "sent"),
    [
        ("float", 1, 1.0),
        ("int", 1, 1),
        ("int", 2.5, 2.5),
        ("float", "many", "many"),
        ("bool", True, True),
        ("numbers", [1, 2.5], [1.0, 2.5]),
        ("numbers", [], []),
        ("texts", ["hog"], ["hog"]),
        ("texts", [], []),
    ],
)
def test_a_value_reaches_the_node_unchanged_for_validation(kind, given, sent):
    parameter = parameter_from_json({"name": "x", "kind": kind}, given)
    found = parameter_value_to_python(parameter.value)
    found = found if isinstance(found, bool | int | float | str) else list(found)
    assert (found, type(found)) == (sent, type(sent))


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        *(("int", value) for value in (None, {}, [1, "two"], [1.0, 10**400], 2**63, -(2**70))),
        *(("int", value) for value in ("\ud800", "default\0more")),
        ("float", 10**400),
        ("texts", ["hog", "\ud800"]),
    ],
)
def test_a_value_without_a_ros_type_is_refused(kind, given):
    with pytest.raises(ValueError, match="'x'"):
        parameter_from_json({"name": "x", "kind": kind}, given)


def test_the_file_has_the_preset_and_the_changed_values():
    known = shape(
        described("preset", "li2007"),
        described("seed", 0),
        described("autostart", False, read_only=True),
        described("particles", 80),
        described("motion.position_noise", 0.7),
        described("cues", ["hog", "color_histogram"]),
    )
    text = parameter_file("/left/pf_tracker", list(known.values()))
    assert yaml.safe_load(text) == {
        "/left/pf_tracker": {
            "ros__parameters": {
                "preset": "li2007",
                "particles": 80,
                "cues": ["hog", "color_histogram"],
            }
        }
    }
