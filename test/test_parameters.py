"""Declared parameters: checked, nested, and named by their full name."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.parameters import (
    ParameterError,
    build,
    declarations,
    declared,
    flatten,
    group,
    parts,
    why_unknown,
)
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS


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


@pytest.mark.parametrize(
    ("values", "name", "allowed"),
    [
        (("green", 3, np.array(["red", "blue"]), "r" * 10**6), "color", "'red' or 'blue'"),
        ((1, "yes"), "open", "true or false"),
        ((10.1, math.nan, math.inf, "fast", True, np.longdouble(11.0)), "engine.power", "0 to 10"),
        ((10**400, np.timedelta64(5, "ns"), np.array([1.0])), "engine.power", "0 to 10"),
        ((0, 4.0, 10**400), "engine.cylinders", "1 to 16"),
        (([1.0], "12", 1.0, b"\x01\x02"), "size", "0 or 2 numbers"),
        (([1.0, 6.0], [1.0, math.nan]), "size", "each 0 to 5"),
        ((range(2), [np.array([1.0, 2.0]), 1.0]), "size", "0 or 2 numbers"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_error_names_the_parameter_the_value_and_the_allowed_values(values, name, allowed):
    for value in values:
        with pytest.raises(ParameterError) as refusal:
            build(Car, {name: value})
        for part in (f"'{name}'", repr(value)[:10], allowed):
            assert part in str(refusal.value)
        assert len(str(refusal.value)) < 400


def test_a_field_that_is_not_declared_is_named_and_a_number_needs_a_range():
    @dataclass(frozen=True)
    class Bare:
        speed: float = 1.0

    with pytest.raises(TypeError, match=r"Bare\.speed is no tunable; make it by `declared`"):
        declarations(Bare)
    with pytest.raises(TypeError, match="needs a range"):
        declared(1.0, "Unbounded.")


def declared_draft(default=2.0):
    return declared(default, "Draft.", minimum=0.1, maximum=9.0)


@dataclass(frozen=True)
class Sail:
    area: float = declared(20.0, "Area.", minimum=1.0, maximum=99.0)
    draft: float = declared_draft()


@dataclass(frozen=True)
class Diesel:
    liters: float = declared(3.0, "Liters.", minimum=0.5, maximum=9.0)
    draft: float = declared_draft()


@dataclass(frozen=True)
class Device:
    age: int = declared(1, "Age.", minimum=0, maximum=99)


@dataclass(frozen=True)
class Radio(Device):
    channel: int = declared(16, "Channel.", minimum=1, maximum=88)


DRIVES, DEVICES = Registry("drive", prefix=""), Registry("device", Device)
for drive, own in {"sail": (Sail,), "diesel": (Diesel,), "oars": ()}.items():
    DRIVES.register(drive, *own)(dict)
for device, own in {"radio": (Radio,), "plotter": (), "spare": (Radio,)}.items():
    DEVICES.register(device, *own)(dict)


@dataclass(frozen=True)
class Drive:
    kind: str = declared("sail", "Kind.", choices=DRIVES, read_only=True)
    of_kinds: dict[str, Any] = parts("kind", DRIVES)
    reefs: int = declared(2, "Reefs.", minimum=0, maximum=4, only_with=("kind", "sail"))


@dataclass(frozen=True)
class Antenna:
    height: float = declared(5.0, "Height.", minimum=0.0, maximum=30.0)


@dataclass(frozen=True)
class Boat:
    name: str = declared("Anna", "Name.")
    hull: str = declared("wood", "Hull.", choices=("wood",))
    drive: Drive = group(Drive)
    devices: tuple[str, ...] = declared(("plotter",), "Devices.", choices=DEVICES)
    of_devices: dict[str, Any] = parts("devices", DEVICES)
    antenna: Antenna = group(Antenna, only_with=("devices", "radio", "spare"))
    ropes: tuple[str, ...] = declared((), "Ropes.", choices=("bow", "stern", "spring"))


# Name to the condition under which it is active.
CONDITIONS = {
    "name": None,
    "drive.kind": None,
    "drive.area": ("drive.kind", ("sail",)),
    "drive.draft": ("drive.kind", ("sail", "diesel")),
    "drive.liters": ("drive.kind", ("diesel",)),
    "drive.reefs": ("drive.kind", ("sail",)),
    "devices": None,
    "radio.age": ("devices", ("radio",)),
    "radio.channel": ("devices", ("radio",)),
    "plotter.age": ("devices", ("plotter",)),
    "spare.age": ("devices", ("spare",)),
    "spare.channel": ("devices", ("spare",)),
    "antenna.height": ("devices", ("radio", "spare")),
    "ropes": None,
}
BOAT = declarations(Boat)


def boats():
    """Random values of some tunables."""
    some_devices = st.lists(st.sampled_from(list(DEVICES)), unique=True).map(tuple)
    possible = {"drive.kind": st.sampled_from(list(DRIVES)), "devices": some_devices}
    for name, declaration in BOAT.items():
        if declaration.type is float:
            possible[name] = st.floats(declaration.minimum, declaration.maximum)
        elif declaration.type is int:
            possible[name] = st.integers(int(declaration.minimum), int(declaration.maximum))
    return st.fixed_dictionaries({}, optional=possible)


def test_tunables_of_all_parts_are_declared_with_their_conditions():
    assert {name: declaration.condition for name, declaration in BOAT.items()} == CONDITIONS
    assert list(BOAT) == list(CONDITIONS)
    assert all(name == declaration.name for name, declaration in BOAT.items())
    # A selector with a single choice is omitted.
    assert "hull" not in BOAT


def test_the_description_contains_the_condition():
    described = {name: declaration.description for name, declaration in BOAT.items()}
    assert described["name"] == "Name."
    assert described["drive.draft"] == "Draft. Used only if 'drive.kind' is 'sail' or 'diesel'."
    assert described["spare.channel"] == "Channel. Used only if 'devices' contains 'spare'."


@given(boats())
def test_a_tunable_is_active_if_its_condition_holds(values):
    values = flatten(build(Boat, values))
    for name, condition in CONDITIONS.items():
        selected = values[condition[0]] if condition else ()
        selected = {selected} if isinstance(selected, str) else set(selected)
        assert BOAT[name].is_active(values) == (
            condition is None or bool(selected & {*condition[1]})
        )


@given(boats())
def test_flatten_is_the_inverse_of_build_for_any_selection(values):
    flat = flatten(build(Boat, values))
    assert list(flat) == list(BOAT)
    assert flat == {name: values.get(name, one.default) for name, one in BOAT.items()}
    assert build(Boat, flat) == build(Boat, values)
    assert build(Boat, {}) == Boat()


def test_parts_share_tunables_that_they_declare_alike():
    boat = build(Boat, {"drive.draft": 3.0, "drive.area": 9.0, "spare.channel": 7})
    assert boat.drive.of_kinds["sail"] == Sail(area=9.0, draft=3.0)
    assert boat.drive.of_kinds["diesel"] == Diesel(draft=3.0)
    assert boat.of_devices["radio"] == Radio()
    assert boat.of_devices["spare"] == Radio(channel=7)


def machine_of(drives):
    @dataclass(frozen=True)
    class Machine:
        kind: str = declared("sail", "Kind.", choices=drives)
        height: float = declared(5.0, "Height.", minimum=0.0, maximum=30.0)
        of_kinds: dict[str, Any] = parts("kind", drives)

    return Machine


def test_a_tunable_of_every_part_is_always_active():
    drives = Registry("drive", prefix="")
    machine = machine_of(drives)
    for name, one in {"sail": Sail, "diesel": Diesel}.items():
        drives.register(name, one)(dict)
    draft = declarations(machine)["draft"]
    assert (draft.condition, draft.description) == (None, "Draft.")
    drives.register("oars")(dict)
    assert declarations(machine)["draft"].condition == ("kind", ("sail", "diesel"))


@dataclass(frozen=True)
class Barge:
    draft: float = declared_draft(default=1.0)


@dataclass(frozen=True)
class Balloon:
    height: float = declared(9.0, "Height.", minimum=0.0, maximum=99.0)


@pytest.mark.parametrize(("other", "name"), [(Barge, "draft"), (Balloon, "height")])
def test_one_name_for_two_tunables_is_refused(other, name):
    drives = Registry("drive", prefix="")
    machine = machine_of(drives)
    drives.register("sail", Sail)(dict)
    # A single choice makes no condition.
    assert list(declarations(machine)) == ["height", "area", "draft"]
    assert declarations(machine)["draft"].condition is None
    drives.register("other", other)(dict)
    reason = f"'{name}' is declared differently for .*other; declare it"
    with pytest.raises(TypeError, match=reason):
        declarations(machine)


WHY_UNKNOWN = {
    "drive.arae": "no parameter 'drive.arae'; did you mean 'drive.area'?",
    "zzz": f"no parameter 'zzz'; there are: {', '.join(CONDITIONS)}",
}


@pytest.mark.parametrize("name", WHY_UNKNOWN)
def test_the_message_for_an_unknown_name(name):
    assert why_unknown(Boat, name) == WHY_UNKNOWN[name]
    with pytest.raises(ParameterError) as refusal:
        build(Boat, {name: 1.0})
    assert str(refusal.value) == WHY_UNKNOWN[name]


@pytest.mark.parametrize(
    "value", [("anchor",), ("bow", "bow"), "bow", ("bow", 1), (("bow",),), None, 1.0, (None,)]
)
def test_a_list_of_strings_holds_each_allowed_string_at_most_once(value):
    with pytest.raises(ParameterError) as refusal:
        build(Boat, {"ropes": value})
    allowed = "list of strings, each at most once, 'bow' or 'stern' or 'spring'"
    assert str(refusal.value) == f"parameter 'ropes' is {value!r}; allowed: {allowed}"
    assert build(Boat, {"ropes": ["stern", "bow"]}).ropes == ("stern", "bow")
    for name in ("drive.kind", "devices"):
        with pytest.raises(ParameterError, match=f"'{name}' is .*; allowed: .*'(sail|radio)'"):
            build(Boat, {name: "kite"})


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_names_only_active_tunables(preset):
    known = declarations(TrackerParameters)
    values = flatten(build(TrackerParameters, PRESETS[preset]))
    assert all(known[name].is_active(values) for name in PRESETS[preset])


def test_whole_numbers_and_scalars_of_numpy_become_the_declared_type():
    car = build(Car, {"engine.power": 2})
    assert car == Car(engine=Engine(power=2.0))
    assert isinstance(car.engine.power, float)
    given = {"engine.power": np.longdouble(2.5), "engine.cylinders": np.int64(8)}
    car = build(Car, {**given, "color": np.str_("blue")})
    assert (car.engine.power, car.engine.cylinders, car.color) == (2.5, 8, "blue")
    types = [type(value) for value in (car.engine.power, car.engine.cylinders, car.color)]
    assert types == [float, int, str]
