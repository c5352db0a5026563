"""Declared parameters on a real node."""

import math
from dataclasses import dataclass

import pytest
from bindings import Bound
from rclpy.parameter import Parameter

from pf_tracker_ros.parameters import declarations, declared


@dataclass(frozen=True)
class Group:
    rate: float = declared(1.0, "How often.", unit="Hz", minimum=0.5, maximum=10.0)
    count: int = declared(3, "How many.", minimum=1, maximum=10)
    box: tuple[float, ...] = declared(
        (), "Where.", unit="px", minimum=0.0, maximum=100.0, lengths=(0, 4)
    )
    mode: str = declared("slow", "Which way.", choices=("slow", "fast"))
    fixed: float = declared(1.0, "Not at run time.", minimum=0.0, maximum=2.0, read_only=True)
    switch: bool = declared(False, "Whether.")


DECLARATIONS = declarations(Group)


@pytest.fixture
def bind(graph):
    """A function that makes a node with the overrides and binds the group to it."""

    def make(**overrides):
        bound = Bound(graph.context(), overrides)
        bound.binding.declare(Group)
        return bound

    return make


def test_every_parameter_gets_its_type_description_range_and_default(bind):
    node = bind().listen().node
    described = {name: node.describe_parameter(name) for name in DECLARATIONS}
    kinds = {name: node.get_parameter(name).type_.name for name in DECLARATIONS}
    assert kinds == {
        "rate": "DOUBLE",
        "count": "INTEGER",
        "box": "DOUBLE_ARRAY",
        "mode": "STRING",
        "fixed": "DOUBLE",
        "switch": "BOOL",
    }
    assert described["rate"].description == "How often. [Hz]"
    assert described["mode"].description == "Which way."
    (limits,) = described["rate"].floating_point_range
    assert (limits.from_value, limits.to_value) == (0.5, 10.0)
    (limits,) = described["count"].integer_range
    assert (limits.from_value, limits.to_value, limits.step) == (1, 10, 1)
    assert "'slow' or 'fast'" in described["mode"].additional_constraints
    assert "0 or 4 numbers, each 0 to 100" in described["box"].additional_constraints
    assert [name for name in described if described[name].read_only] == ["fixed"]
    assert node.get_parameter("rate").value == 1.0
    assert list(node.get_parameter("box").value) == []


def test_integers_are_valid_floats(bind):
    bound = bind(rate=2, box=[1, 2, 3, 4]).listen()
    assert bound.binding.values["box"] == (1.0, 2.0, 3.0, 4.0)
    assert bound.node.get_parameter("rate").value == 2.0
    assert bound.set({"rate": 3, "box": [5, 6, 7, 8]}).successful
    assert bound.binding.values["rate"] == 3.0
    assert bound.binding.values["box"] == (5.0, 6.0, 7.0, 8.0)
    assert isinstance(bound.node.get_parameter("rate").value, float)
    assert not bound.reports


# What else is invalid: test/test_parameters.py.
INVALID = {
    "text for a number": ("rate", "quick", "float, 0.5 to 10"),
    "above the range": ("count", 11, "int, 1 to 10"),
    "not a number": ("rate", math.nan, "float, 0.5 to 10"),
    "no choice": ("mode", "swift", "'slow' or 'fast'"),
    "out of range in a list": ("box", [1.0, 2.0, 300.0, 4.0], "each 0 to 100"),
    "a number for a flag": ("switch", 1, "true or false"),
}


@pytest.mark.parametrize("kind", INVALID)
def test_an_invalid_value_is_refused_at_start_up_and_at_run_time(bind, kind):
    name, value, allowed = INVALID[kind]
    default = DECLARATIONS[name].default

    at_start_up = bind(**{name: value}).listen()
    (report,) = at_start_up.reports
    assert report.startswith(f"parameter '{name}' is {value!r}")
    assert allowed in report
    assert at_start_up.binding.refused == {name: report}
    assert at_start_up.binding.values[name] == default

    at_run_time = bind().listen()
    result = at_run_time.set({name: value})
    assert not result.successful
    assert result.reason
    assert at_run_time.reports == [report]
    assert at_run_time.binding.values[name] == default
    assert not at_run_time.binding.refused
    assert not at_run_time.applied


def test_a_read_only_parameter_can_change_only_until_all_values_are_valid(bind):
    bound = bind(fixed=3.0).listen()
    assert not bound.node.describe_parameter("fixed").read_only
    assert bound.set({"fixed": 0.5}).successful
    assert bound.node.describe_parameter("fixed").read_only
    result = bound.set({"fixed": 0.6})
    assert not result.successful
    assert "fixed" in result.reason
    assert "read-only while the node runs" in bound.reports[-1]
    assert bound.binding.values["fixed"] == 0.5


def test_a_parameter_cannot_be_deleted(bind):
    bound = bind().listen()
    assert not bound.node.set_parameters_atomically([Parameter("rate")]).successful
    assert bound.node.get_parameter("rate").value == 1.0
