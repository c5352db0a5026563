"""Parameters that are on a node only while what they belong to is chosen."""

from dataclasses import dataclass
from typing import Any

import pytest
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.parameters import chosen, declared, group
from pf_tracker_ros.registry import NoParameters


@dataclass(frozen=True)
class Steam:
    pressure: float = declared(5.0, "Pressure.", unit="bar", minimum=0.0, maximum=20.0)
    coal: tuple[str, ...] = declared(("black",), "Coal.", choices=("black", "brown"))
    load: float = declared(1.0, "Load.", minimum=0.0, maximum=3.0)


@dataclass(frozen=True)
class Electric:
    cells: int = declared(6, "Cells.", minimum=1, maximum=12)
    load: float = declared(2.0, "Load of the cells.", minimum=0.0, maximum=3.0)


ENGINES = {"steam": Steam, "electric": Electric, "none": NoParameters}


@dataclass(frozen=True)
class Engine:
    kind: str = declared("steam", "Kind.", choices=ENGINES, read_only=True)
    of_kind: dict[str, Any] = chosen("kind", lambda kind: {"": ENGINES[kind]})


@dataclass(frozen=True)
class Bell:
    tone: int = declared(440, "Tone.", minimum=1, maximum=10_000)


@dataclass(frozen=True)
class Train:
    cars: int = declared(3, "Cars.", minimum=0, maximum=9)
    engine: Engine = group(Engine)
    signals: tuple[str, ...] = declared((), "Signals.", choices=("bell", "lamp"))
    of_signals: dict[str, Any] = chosen(
        "signals", lambda names: {name: Bell for name in names if name == "bell"}
    )


@dataclass(frozen=True)
class Line:
    timetable: str = declared("usual", "Timetable.", choices=("usual", "festive", "modern"))


TIMETABLES = {
    "usual": {},
    "festive": {"cars": 9, "signals": ("bell",), "bell.tone": 880},
    "modern": {"engine.kind": "electric", "engine.cells": 12},
}
STEAM = {
    "engine.kind": "steam",
    "engine.pressure": 5.0,
    "engine.coal": ("black",),
    "engine.load": 1.0,
}
ELECTRIC = {"engine.kind": "electric", "engine.cells": 6, "engine.load": 2.0}
USUAL = {"timetable": "usual", "cars": 3, **STEAM, "signals": ()}
FESTIVE = {**USUAL, "timetable": "festive", **TIMETABLES["festive"]}


class Bound:
    """A node with a binding, all that it reported, and all that it applied."""

    def __init__(self, context, overrides, superseded):
        parameters = [Parameter(name, value=value) for name, value in overrides.items()]
        self.node = Node("bound", context=context, parameter_overrides=parameters)
        self.reports, self.applied = [], []
        self.binding = ParameterBinding(self.node, self.reports.append)
        self.binding.declare(Line)
        self.binding.declare(
            Train,
            usual=lambda values: TIMETABLES[values["timetable"]],
            renewed_by="timetable",
            superseded=superseded,
            keeps_read_only=False,
        )
        self.binding.listen(
            apply=lambda changes: self.applied.append(dict(changes)), check=self._check
        )

    @staticmethod
    def _check(values):
        if values["engine.kind"] == "none" and values["cars"]:
            raise ValueError("no cars without an engine")

    def set(self, values):
        return self.node.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in values.items()]
        )

    @property
    def on_node(self):
        """What the node itself says, apart from what every node has."""
        names = [name for name in self.node._parameters if name not in OF_EVERY_NODE]
        found = {name: self.node.get_parameter(name).value for name in names}
        return {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in found.items()
        }

    def is_as(self, expected):
        return self.on_node == self.binding.values == expected


OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")


@pytest.fixture
def bind(graph):
    def make(overrides=None, superseded=()):
        return Bound(graph.context(), overrides or {}, superseded)

    return make


def without(values, *prefixes):
    return {name: value for name, value in values.items() if not name.startswith(prefixes)}


def test_only_what_is_chosen_is_on_the_node(bind):
    assert bind().is_as(USUAL)
    assert bind({"timetable": "festive"}).is_as(FESTIVE)


def test_what_is_chosen_at_start_up_is_known_before_what_it_brings(bind):
    bound = bind(
        {"bell.tone": 3, "engine.cells": 2, "engine.kind": "electric", "signals": ["bell"]}
    )
    assert bound.is_as(
        {**without(USUAL, "engine"), **ELECTRIC, "engine.cells": 2}
        | {"signals": ("bell",), "bell.tone": 3}
    )
    assert not bound.reports


def test_a_choice_at_run_time_brings_its_parameters_and_takes_the_others_away(bind):
    bound = bind({"engine.load": 2.5})
    assert bound.set({"engine.kind": "electric"}).successful
    # What both have keeps its value.
    electric = {**without(USUAL, "engine"), **ELECTRIC, "engine.load": 2.5}
    assert bound.is_as(electric)
    assert bound.applied == [{"engine.kind": "electric", "engine.cells": 6}]
    descriptor = bound.node.describe_parameter("engine.load")
    assert descriptor.description == "Load of the cells."
    assert bound.node.describe_parameter("engine.cells").integer_range[0].to_value == 12
    assert bound.set({"engine.kind": "none"}).successful is False
    assert bound.is_as(electric)
    assert bound.set({"engine.kind": "steam"}).successful
    assert bound.is_as({**USUAL, "engine.load": 2.5})
    assert bound.set({"engine.pressure": 6.0}).successful


def test_what_comes_to_be_has_the_value_that_is_usual_then(bind):
    bound = bind({"timetable": "modern", "engine.cells": 3})
    assert bound.set({"engine.kind": "steam"}).successful
    assert bound.set({"engine.kind": "electric"}).successful
    assert bound.on_node["engine.cells"] == 12


def test_a_whole_request_gives_values_of_what_is_only_coming_to_be(bind):
    bound = bind()
    request = {"bell.tone": 7, "engine.cells": 4, "signals": ["bell"], "engine.kind": "electric"}
    assert bound.set(request).successful
    expected = {**without(USUAL, "engine"), **ELECTRIC, "engine.cells": 4, "engine.load": 1.0}
    assert bound.is_as(expected | {"signals": ("bell",), "bell.tone": 7})
    assert bound.applied == [request | {"signals": ("bell",)}]


def test_what_renews_a_group_makes_all_of_it_begin_anew_but_what_is_requested(bind):
    bound = bind({"cars": 1, "engine.pressure": 9.0})
    assert bound.set({"bell.tone": 441, "timetable": "festive"}).successful
    assert bound.is_as(FESTIVE | {"bell.tone": 441})
    assert bound.applied == [FESTIVE | {"bell.tone": 441}]
    assert bound.set({"timetable": "usual"}).successful
    assert bound.is_as(USUAL)


REFUSED = {
    "a wrong value of what comes to be": (
        {"signals": ["bell"], "bell.tone": 0},
        "parameter 'bell.tone' is 0",
    ),
    "a wrong value beside a choice": ({"engine.kind": "electric", "cars": 10}, "'cars' is 10"),
    "a wrong choice": ({"engine.kind": "diesel"}, "'engine.kind' is 'diesel'"),
    "a wrong choice of several": ({"signals": ["bell", "horn"]}, "'bell' or 'lamp'"),
    "a choice twice": ({"signals": ["bell", "bell"]}, "each at most once"),
    "one choice for several": ({"signals": "bell"}, "list of strings"),
    "a contradiction": ({"engine.kind": "none"}, "no cars without an engine"),
    "a contradiction with what comes to be": (
        {"engine.kind": "none", "signals": ["bell"], "bell.tone": 5},
        "no cars without an engine",
    ),
    "a foreign parameter of a wrong type": (
        {"signals": ["bell"], "bell.tone": 5, "use_sim_time": 1},
        "expected 'Type.BOOL'",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_refused_request_leaves_all_as_it_was(bind, kind):
    request, reason = REFUSED[kind]
    bound = bind({"engine.load": 0.5})
    result = bound.set(request)
    assert not result.successful
    assert reason in result.reason
    assert bound.is_as(USUAL | {"engine.load": 0.5})
    assert not bound.applied
    assert bound.set({"cars": 4, "signals": ["bell", "lamp"]}).successful
    assert bound.is_as(
        USUAL | {"engine.load": 0.5, "cars": 4, "signals": ("bell", "lamp"), "bell.tone": 440}
    )


UNKNOWN = {
    "not chosen": ({"engine.cells": 4}, "'engine.cells' here; it needs engine.kind 'electric'"),
    "no longer chosen": (
        {"engine.kind": "electric", "engine.pressure": 4.0},
        "'engine.pressure' here; it needs engine.kind 'steam'",
    ),
    "misspelt": ({"engine.pressurre": 1.0}, "'engine.pressurre' (did you mean 'engine.pressure'?)"),
    "of no part": ({"wings": 2}, "there is no parameter 'wings' (there are: cars, "),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_what_is_not_there_is_refused_with_what_to_do(bind, kind):
    request, reason = UNKNOWN[kind]
    bound = bind()
    with pytest.raises(ParameterNotDeclaredException) as refusal:
        bound.set({"cars": 1, **request})
    assert reason in str(refusal.value)
    assert [report for report in bound.reports if reason in report] == bound.reports
    assert bound.is_as(USUAL)
    assert not bound.applied


def test_what_is_not_there_at_start_up_has_no_effect(bind):
    bound = bind({"engine.cells": 4, "horn": 1, "cars": 1})
    assert bound.reports == [
        "no parameter 'engine.cells' here; it needs engine.kind 'electric'; it has no effect",
        f"there is no parameter 'horn' (there are: {', '.join(sorted(USUAL))}); it has no effect",
    ]
    assert not bound.binding.refused
    assert bound.is_as(USUAL | {"cars": 1})


def test_what_is_superseded_is_neither_taken_nor_reported(bind):
    given = {"engine.cells": 4, "cars": 1, "signals": ["horn"], "timetable": "festive", "wings": 2}
    bound = bind(given, superseded=("engine.cells", "cars", "timetable"))
    assert bound.is_as(FESTIVE)
    assert set(bound.binding.refused) == {"signals"}
    bound = bind(given, superseded=given)
    assert not bound.binding.refused
    (report,) = bound.reports
    assert report.startswith("there is no parameter 'wings' ")


def test_what_was_refused_of_a_part_is_settled_when_the_part_goes(bind):
    bound = bind({"engine.pressure": -1.0})
    assert set(bound.binding.refused) == {"engine.pressure"}
    assert bound.set({"engine.kind": "electric"}).successful
    assert not bound.binding.refused


def test_a_wrong_choice_at_start_up_leaves_the_usual_one(bind):
    bound = bind({"timetable": "festive", "signals": ["horn"], "bell.tone": 5})
    assert set(bound.binding.refused) == {"signals"}
    assert bound.is_as(FESTIVE | {"bell.tone": 5})


def test_a_list_of_strings_is_one_on_the_node(bind):
    bound = bind({"engine.coal": []})
    assert bound.binding.values["engine.coal"] == ()
    assert bound.node.get_parameter("engine.coal").type_ == Parameter.Type.STRING_ARRAY
    descriptor = bound.node.describe_parameter("engine.coal")
    assert descriptor.type == Parameter.Type.STRING_ARRAY.value
    assert "'black' or 'brown'" in descriptor.additional_constraints
    assert bound.set({"engine.coal": ["brown", "black"]}).successful
    assert bound.binding.values["engine.coal"] == ("brown", "black")
    # What has no elements, has none of strings either.
    for empty in (Parameter("engine.coal"), Parameter("engine.coal", value=[])):
        assert bound.set({"engine.coal": ["brown"]}).successful
        assert bound.node.set_parameters_atomically([empty]).successful
        assert bound.binding.values["engine.coal"] == ()
        assert bound.node.get_parameter("engine.coal").type_ == Parameter.Type.STRING_ARRAY
    assert not bound.set({"engine.coal": [1, 2]}).successful


def test_other_parameters_of_the_node_stay(bind):
    bound = bind()
    bound.node.declare_parameter("other", 1)
    request = {"other": 2, "engine.kind": "electric", "engine.cells": 2}
    assert bound.set(request).successful
    assert bound.node.get_parameter("other").value == 2
    assert bound.on_node == {**bound.binding.values, "other": 2}
