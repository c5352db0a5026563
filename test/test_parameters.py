"""Declared parameters: checked, nested, and named by their full name."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pf_tracker_ros.parameters import (
    ParameterError,
    all_declarations,
    build,
    change,
    choosers,
    chosen,
    declarations,
    declared,
    flatten,
    group,
    why_unknown,
)
from pf_tracker_ros.registry import NoParameters
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters


@dataclass(frozen=True)
class Engine:
    power: float = declared(1.5, "Power.", unit="kW", minimum=0.0, maximum=10.0)
    cylinders: int = declared(4, "Cylinders.", minimum=1, maximum=16, read_only=True)


@dataclass(frozen=True)
class Car:
    color: str = declared("red", "Color.", choices=("red", "blue"))
    open: bool = declared(False, "Whether it has no roof.")
    size: tuple[float, ...] = declared(
        (), "Width and height.", minimum=0.0, maximum=5.0, lengths=(0, 2)
    )
    engine: Engine = group(Engine)


def test_names_are_full_and_in_order_of_declaration():
    assert list(declarations(Car)) == [
        "color",
        "open",
        "size",
        "engine.power",
        "engine.cylinders",
    ]
    declaration = declarations(Car)["engine.power"]
    assert (declaration.type, declaration.default, declaration.unit) == (float, 1.5, "kW")


def test_what_is_not_named_keeps_its_default():
    car = build(Car, {"engine.power": 2})
    assert car == Car(engine=Engine(power=2.0))
    assert isinstance(car.engine.power, float)


def test_flatten_is_the_inverse_of_build():
    values = {
        "color": "blue",
        "open": True,
        "size": (1.0, 2.0),
        "engine.power": 3.0,
        "engine.cylinders": 6,
    }
    assert flatten(build(Car, values)) == values


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("color", "green", "'red' or 'blue'"),
        ("color", 3, "'red' or 'blue'"),
        ("open", 1, "true or false"),
        ("open", "yes", "true or false"),
        ("engine.power", 10.1, "0 to 10"),
        ("engine.power", math.nan, "0 to 10"),
        ("engine.power", math.inf, "0 to 10"),
        ("engine.power", "fast", "0 to 10"),
        ("engine.power", True, "0 to 10"),
        ("engine.cylinders", 0, "1 to 16"),
        ("engine.cylinders", 4.0, "1 to 16"),
        ("size", [1.0], "0 or 2 numbers"),
        ("size", [1.0, 6.0], "each 0 to 5"),
        ("size", [1.0, math.nan], "each 0 to 5"),
        ("size", "12", "0 or 2 numbers"),
        ("size", 1.0, "0 or 2 numbers"),
    ],
)
def test_a_refusal_names_the_parameter_the_value_and_what_is_allowed(name, value, allowed):
    with pytest.raises(ParameterError) as refusal:
        build(Car, {name: value})
    for part in (f"'{name}'", repr(value), allowed):
        assert part in str(refusal.value)


def test_an_unknown_name_is_refused_listing_those_there_are():
    with pytest.raises(ParameterError, match=r"'wheels'; there are: color, open"):
        build(Car, {"wheels": 4})


def test_a_name_that_is_nearly_right_is_refused_with_the_right_one():
    with pytest.raises(ParameterError, match=r"'engine\.powr'; did you mean 'engine\.power'\?$"):
        build(Car, {"engine.powr": 1.0})


def test_a_field_that_is_not_declared_is_named():
    @dataclass(frozen=True)
    class Bare:
        speed: float = 1.0

    with pytest.raises(TypeError, match=r"Bare\.speed is no tunable; make it by `declared`"):
        declarations(Bare)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_float_is_taken_exactly_if_it_is_in_range(value):
    if 0.0 <= value <= 10.0:
        assert build(Car, {"engine.power": value}).engine.power == value
    else:
        with pytest.raises(ParameterError):
            build(Car, {"engine.power": value})


def test_numpy_scalars_count_as_numbers():
    car = build(Car, {"engine.power": np.float32(2.5), "engine.cylinders": np.int64(8)})
    assert (car.engine.power, car.engine.cylinders) == (2.5, 8)
    assert type(car.engine.cylinders) is int


def test_a_number_without_a_range_cannot_be_declared():
    with pytest.raises(TypeError, match="needs a range"):
        declared(1.0, "Unbounded.")


@dataclass(frozen=True)
class Sail:
    area: float = declared(20.0, "Area.", minimum=1.0, maximum=99.0)
    draft: float = declared(2.0, "Draft.", minimum=0.1, maximum=9.0)


@dataclass(frozen=True)
class Diesel:
    liters: float = declared(3.0, "Liters.", minimum=0.5, maximum=9.0)
    draft: float = declared(2.0, "Draft.", minimum=0.1, maximum=9.0)


@dataclass(frozen=True)
class Radio:
    channel: int = declared(16, "Channel.", minimum=1, maximum=88)


DRIVES = {"sail": Sail, "diesel": Diesel, "oars": NoParameters}
DEVICES = {"radio": Radio, "plotter": NoParameters, "spare": Radio}


@dataclass(frozen=True)
class Drive:
    kind: str = declared("sail", "Kind.", choices=DRIVES, read_only=True)
    of_kind: dict[str, Any] = chosen("kind", lambda kind: {"": DRIVES[kind]})


@dataclass(frozen=True)
class Antenna:
    height: float = declared(5.0, "Height.", minimum=0.0, maximum=30.0)


@dataclass(frozen=True)
class Boat:
    name: str = declared("Anna", "Name.")
    hull: str = declared("wood", "Hull.", choices=("wood",))
    drive: Drive = group(Drive)
    devices: tuple[str, ...] = declared(("plotter",), "Devices.", choices=DEVICES)
    of_devices: dict[str, Any] = chosen(
        "devices", lambda names: {name: DEVICES[name] for name in names}
    )
    of_antenna: dict[str, Any] = chosen(
        "devices", lambda names: {"antenna": Antenna} if {"radio", "spare"} & set(names) else {}
    )
    ropes: tuple[str, ...] = declared((), "Ropes.", choices=("bow", "stern", "spring"))


ALWAYS = ["name", "drive.kind", "devices", "ropes"]
OF_DRIVES = {
    "sail": ["drive.area", "drive.draft"],
    "diesel": ["drive.liters", "drive.draft"],
    "oars": [],
}
KINDS = st.sampled_from(list(DRIVES))
SOME_DEVICES = st.lists(st.sampled_from(list(DEVICES)), unique=True).map(tuple)


def boats():
    """Any values that go together, some of them left out."""

    def values(choice):
        kind, devices = choice
        there = declarations(Boat, {"drive.kind": kind, "devices": devices})
        possible = {
            "drive.kind": st.just(kind),
            "devices": st.just(devices),
            "name": st.text(),
            "ropes": st.lists(st.sampled_from(["bow", "stern", "spring"]), unique=True).map(tuple),
        }
        for name, declaration in there.items():
            if declaration.type is float:
                possible[name] = st.floats(declaration.minimum, declaration.maximum)
            elif declaration.type is int:
                possible[name] = st.integers(int(declaration.minimum), int(declaration.maximum))
        needed = {name: possible.pop(name) for name in ("drive.kind", "devices")}
        return st.fixed_dictionaries(needed, optional=possible)

    return st.tuples(KINDS, SOME_DEVICES).flatmap(values)


@given(KINDS, SOME_DEVICES)
def test_there_is_what_is_chosen_and_nothing_else(kind, devices):
    there = declarations(Boat, {"drive.kind": kind, "devices": devices})
    expected = {*ALWAYS, *OF_DRIVES[kind]}
    expected |= {f"{name}.channel" for name in devices if name != "plotter"}
    if set(devices) - {"plotter"}:
        expected.add("antenna.height")
    assert set(there) == expected
    assert all(name == declaration.name for name, declaration in there.items())
    # A choice among one is none.
    assert "hull" not in there


def test_what_is_not_named_chooses_by_default():
    assert list(declarations(Boat)) == [
        "name",
        "drive.kind",
        "drive.area",
        "drive.draft",
        "devices",
        "ropes",
    ]


@given(boats())
def test_flatten_is_the_inverse_of_build_whatever_is_chosen(values):
    flat = flatten(build(Boat, values))
    assert flat.keys() == declarations(Boat, values).keys()
    assert values.items() <= flat.items()
    assert all(
        flat[name] == declaration.default
        for name, declaration in declarations(Boat, values).items()
        if name not in values
    )
    assert build(Boat, flat) == build(Boat, values)


@given(boats(), boats())
def test_what_a_change_leaves_keeps_its_value_and_the_rest_has_its_default(before, changes):
    before = flatten(build(Boat, before))
    after = flatten(build(Boat, change(Boat, before, changes)))
    known = declarations(Boat, after)
    for name, declaration in known.items():
        usual = before.get(name, declaration.default)
        assert after[name] == changes.get(name, usual)


@given(boats(), boats())
def test_what_does_not_exist_with_a_change_is_refused(before, wrong):
    before = flatten(build(Boat, before))
    strange = wrong.keys() - before.keys()
    assume(strange)
    changes = {name: wrong[name] for name in strange}
    with pytest.raises(ParameterError, match="no parameter"):
        build(Boat, change(Boat, before, changes))


def test_all_declarations_are_those_of_every_choice_and_tell_what_they_need():
    every = all_declarations(Boat)
    assert {name: declaration.only_with for name, declaration in every.items()} == {
        **dict.fromkeys(ALWAYS, ""),
        "drive.area": "drive.kind 'sail'",
        "drive.liters": "drive.kind 'diesel'",
        "drive.draft": "drive.kind 'sail' or 'diesel'",
        "radio.channel": "devices 'radio'",
        "spare.channel": "devices 'spare'",
        "antenna.height": "devices 'radio' or 'spare'",
    }


@given(KINDS, SOME_DEVICES)
def test_all_declarations_hold_those_of_any_choice(kind, devices):
    every = all_declarations(Boat)
    for name, declaration in declarations(Boat, {"drive.kind": kind, "devices": devices}).items():
        assert dataclasses.replace(every[name], only_with="") == declaration


def test_the_choosers_are_always_there():
    assert list(choosers(Boat)) == ["drive.kind", "devices"]
    assert choosers(Boat)["devices"] == declarations(Boat)["devices"]
    assert choosers(Car) == {}


WHY_UNKNOWN = {
    "drive.area": "no parameter 'drive.area' here; it needs drive.kind 'sail'",
    "antenna.height": "no parameter 'antenna.height' here; it needs devices 'radio' or 'spare'",
    "rudder": "no parameter 'rudder'; there are: name, drive.kind, devices, ropes",
}


@pytest.mark.parametrize("name", WHY_UNKNOWN)
def test_why_a_name_is_not_there_is_told_with_what_to_do(name):
    rowed = {"drive.kind": "oars"}
    assert why_unknown(Boat, name, rowed) == WHY_UNKNOWN[name]
    with pytest.raises(ParameterError) as refusal:
        build(Boat, {**rowed, name: 1.0})
    assert str(refusal.value) == WHY_UNKNOWN[name]


@pytest.mark.parametrize(
    "value", [("anchor",), ("bow", "bow"), "bow", ("bow", 1), (("bow",),), None, 1.0, (None,)]
)
def test_a_list_of_strings_holds_what_is_allowed_each_at_most_once(value):
    with pytest.raises(ParameterError) as refusal:
        build(Boat, {"ropes": value})
    allowed = "list of strings, each at most once, 'bow' or 'stern' or 'spring'"
    assert str(refusal.value) == f"parameter 'ropes' is {value!r}; allowed: {allowed}"


def test_a_list_of_strings_keeps_its_order():
    assert build(Boat, {"ropes": ["stern", "bow"]}).ropes == ("stern", "bow")
    assert build(Boat, {"ropes": []}).ropes == ()


@pytest.mark.parametrize("name", ["drive.kind", "devices"])
def test_a_wrong_choice_is_refused_with_what_can_be_chosen(name):
    with pytest.raises(ParameterError, match=f"'{name}' is .*; allowed: .*'(sail|radio)'"):
        declarations(Boat, {name: "kite"})


def test_a_parameter_of_the_tracker_is_the_same_whatever_it_belongs_to():
    every = all_declarations(TrackerParameters)
    for chooser in choosers(TrackerParameters).values():
        for choice in chooser.choices:
            value = (choice,) if chooser.type == tuple[str, ...] else choice
            for name, one in declarations(TrackerParameters, {chooser.name: value}).items():
                assert dataclasses.replace(every[name], only_with="") == one


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_names_only_what_there_is_with_it(preset):
    assert PRESETS[preset].keys() <= preset_parameters(preset).keys()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("engine.power", np.longdouble(11.0)),
        ("engine.power", 10**400),
        ("engine.power", np.timedelta64(5, "ns")),
        ("engine.power", np.array([1.0])),
        ("engine.cylinders", 10**400),
        ("color", np.array(["red", "blue"])),
        ("size", b"\x01\x02"),
        ("size", range(2)),
        ("size", [np.array([1.0, 2.0]), 1.0]),
        ("color", "r" * 10**6),
    ],
    ids=lambda value: str(value)[:20],
)
def test_whatever_is_not_allowed_is_refused_in_few_words(name, value):
    with pytest.raises(ParameterError) as refusal:
        build(Car, {name: value})
    assert len(str(refusal.value)) < 400


def test_long_doubles_and_strings_of_numpy_are_taken():
    car = build(Car, {"engine.power": np.longdouble(2.5), "color": np.str_("blue")})
    assert (type(car.engine.power), type(car.color)) == (float, str)
