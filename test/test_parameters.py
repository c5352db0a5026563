"""Declared parameters: checked, nested, and named by their full name."""

import math
from dataclasses import dataclass

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
)


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
    with pytest.raises(ParameterError, match=r"'engine\.speed'; there are: color, open"):
        build(Car, {"engine.speed": 1.0})


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
