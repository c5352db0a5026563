"""A parameter of one group resets the parameters of another one."""

from dataclasses import dataclass
from typing import Any

import pytest
from bindings import Bound
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter

from pf_tracker_ros.parameters import declared, group, parts
from pf_tracker_ros.registry import Registry


@dataclass(frozen=True)
class Steam:
    pressure: float = declared(5.0, "Pressure.", unit="bar", minimum=0.0, maximum=20.0)
    coal: tuple[str, ...] = declared(("black",), "Coal.", choices=("black", "brown"))


@dataclass(frozen=True)
class Electric:
    cells: int = declared(6, "Cells.", minimum=1, maximum=12)


ENGINES = Registry("engine", prefix="")
for name, own in {"steam": (Steam,), "electric": (Electric,), "none": ()}.items():
    ENGINES.register(name, *own)(dict)


@dataclass(frozen=True)
class Engine:
    kind: str = declared("steam", "Kind.", choices=ENGINES, read_only=True)
    kinds: dict[str, Any] = parts("kind", ENGINES)


@dataclass(frozen=True)
class Bell:
    tone: int = declared(440, "Tone.", minimum=1, maximum=10_000)


@dataclass(frozen=True)
class Train:
    cars: int = declared(3, "Cars.", minimum=0, maximum=9)
    engine: Engine = group(Engine)
    signals: tuple[str, ...] = declared((), "Signals.", choices=("bell", "lamp"))
    bell: Bell = group(Bell, only_with=("signals", "bell"))


@dataclass(frozen=True)
class Line:
    timetable: str = declared("usual", "Timetable.", choices=("usual", "festive", "modern"))


TIMETABLES = {
    "usual": {},
    "festive": {"cars": 9, "signals": ("bell",), "bell.tone": 880},
    "modern": {"engine.kind": "electric", "engine.cells": 12},
}
DEFAULTS = {
    "timetable": "usual",
    "cars": 3,
    "engine.kind": "steam",
    "engine.pressure": 5.0,
    "engine.coal": ("black",),
    "engine.cells": 6,
    "signals": (),
    "bell.tone": 440,
}
FESTIVE = {**DEFAULTS, "timetable": "festive", **TIMETABLES["festive"]}


def check(values):
    if values["engine.kind"] == "none" and values["cars"]:
        raise ValueError("no cars without an engine")


@pytest.fixture
def bind(graph):
    """A function that makes a node with the overrides and binds both groups to it."""

    def make(overrides=None, superseded=()):
        bound = Bound(graph.context(), overrides or {})
        bound.binding.declare(Line)
        bound.binding.declare(
            Train,
            defaults=lambda values: TIMETABLES[values["timetable"]],
            reset_by={"timetable": lambda before, after: True},
            superseded=superseded,
            keeps_read_only=False,
        )
        return bound.listen(check=check)

    return make


def test_the_parameters_of_every_part_are_on_the_node(bind):
    bound = bind()
    assert bound.is_as(DEFAULTS)
    assert bind({"timetable": "festive"}).is_as(FESTIVE)
    descriptor = bound.node.describe_parameter("engine.cells")
    assert descriptor.description == "Cells. Used only if 'engine.kind' is 'electric'."
    assert descriptor.integer_range[0].to_value == 12


def test_a_choice_keeps_the_other_values(bind):
    bound = bind({"engine.cells": 2, "signals": ["bell"], "bell.tone": 3})
    given = DEFAULTS | {"engine.cells": 2, "signals": ("bell",), "bell.tone": 3}
    assert bound.is_as(given)
    assert bound.set({"engine.kind": "electric"}).successful
    assert bound.is_as(given | {"engine.kind": "electric"})
    assert bound.applied == [{"engine.kind": "electric"}]
    assert not bound.set({"engine.kind": "none"}).successful
    assert bound.set({"engine.pressure": 6.0}).successful
    assert bound.is_as(given | {"engine.kind": "electric", "engine.pressure": 6.0})
    assert bound.reports == ["no cars without an engine"]


def test_a_reset_keeps_only_the_requested_values(bind):
    bound = bind({"cars": 1, "engine.pressure": 9.0})
    assert bound.set({"bell.tone": 441, "timetable": "festive"}).successful
    assert bound.is_as(FESTIVE | {"bell.tone": 441})
    assert bound.applied == [FESTIVE | {"bell.tone": 441}]
    assert bound.set({"timetable": "usual"}).successful
    assert bound.is_as(DEFAULTS)


REFUSED = {
    "an invalid value of a part that is chosen with it": (
        {"signals": ["bell"], "bell.tone": 0},
        "parameter 'bell.tone' is 0",
    ),
    "an invalid choice": ({"engine.kind": "diesel"}, "'engine.kind' is 'diesel'"),
    "a contradiction beside a chosen part": (
        {"engine.kind": "none", "signals": ["bell"], "bell.tone": 5},
        "no cars without an engine",
    ),
    "another parameter of another type": (
        {"signals": ["bell"], "bell.tone": 5, "use_sim_time": 1},
        "expected 'Type.BOOL'",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_refused_request_changes_nothing(bind, kind):
    request, reason = REFUSED[kind]
    bound = bind({"engine.cells": 2})
    before = DEFAULTS | {"engine.cells": 2}
    result = bound.set(request)
    assert not result.successful
    assert reason in result.reason
    assert bound.is_as(before)
    assert not bound.applied
    assert bound.set({"cars": 4, "signals": ["bell", "lamp"]}).successful
    assert bound.is_as(before | {"cars": 4, "signals": ("bell", "lamp")})


UNKNOWN = {
    "misspelt": ({"engine.pressurre": 1.0}, "'engine.pressurre' (did you mean 'engine.pressure'?)"),
    "of no part": ({"wings": 2}, "no parameter 'wings' (there are: bell.tone, cars, "),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_an_unknown_parameter_is_refused_with_a_hint(bind, kind):
    request, reason = UNKNOWN[kind]
    bound = bind()
    with pytest.raises(ParameterNotDeclaredException) as refusal:
        bound.set({"cars": 1, **request})
    assert reason in str(refusal.value)
    assert [report for report in bound.reports if reason in report] == bound.reports
    assert bound.is_as(DEFAULTS)
    assert not bound.applied


def test_an_unknown_parameter_at_start_up_has_no_effect(bind):
    bound = bind({"horn": 1, "cars": 1})
    assert bound.reports == [
        f"no parameter 'horn' (there are: {', '.join(sorted(DEFAULTS))}); it has no effect"
    ]
    assert not bound.binding.refused
    assert bound.is_as(DEFAULTS | {"cars": 1})


def test_superseded_values_are_neither_applied_nor_reported(bind):
    given = {"engine.cells": 4, "cars": 1, "signals": ["horn"], "timetable": "festive", "wings": 2}
    bound = bind(given, superseded=("engine.cells", "cars", "timetable"))
    assert bound.is_as(FESTIVE)
    assert set(bound.binding.refused) == {"signals"}
    bound = bind(given, superseded=given)
    assert not bound.binding.refused
    (report,) = bound.reports
    assert report.startswith("no parameter 'wings' ")


def test_a_reset_corrects_refused_values(bind):
    bound = bind({"engine.cells": 0})
    assert set(bound.binding.refused) == {"engine.cells"}
    assert bound.set({"engine.kind": "electric"}).successful
    assert set(bound.binding.refused) == {"engine.cells"}
    assert bound.set({"timetable": "modern"}).successful
    assert not bound.binding.refused


def test_a_list_of_strings_is_a_string_array(bind):
    bound = bind({"engine.coal": []})
    assert bound.binding.values["engine.coal"] == ()
    assert bound.node.get_parameter("engine.coal").type_ == Parameter.Type.STRING_ARRAY
    descriptor = bound.node.describe_parameter("engine.coal")
    assert descriptor.type == Parameter.Type.STRING_ARRAY.value
    assert "'black' or 'brown'" in descriptor.additional_constraints
    assert bound.set({"engine.coal": ["brown", "black"]}).successful
    assert bound.binding.values["engine.coal"] == ("brown", "black")
    # An empty list has no type of elements.
    for empty in (Parameter("engine.coal"), Parameter("engine.coal", value=[])):
        assert bound.set({"engine.coal": ["brown"]}).successful
        assert bound.node.set_parameters_atomically([empty]).successful
        assert bound.binding.values["engine.coal"] == ()
        assert bound.node.get_parameter("engine.coal").type_ == Parameter.Type.STRING_ARRAY
    assert not bound.set({"engine.coal": [1, 2]}).successful


def test_other_parameters_of_the_node_stay(bind):
    bound = bind()
    bound.node.declare_parameter("other", 1)
    request = {"other": 2, "engine.cells": 2, "engine.kind": "electric"}
    assert bound.set(request).successful
    assert bound.node.get_parameter("other").value == 2
    assert bound.on_node == {**bound.binding.values, "other": 2}
