"""Copies of frozen values, beside `dataclasses.replace`."""

import dataclasses
from functools import cached_property

import pytest

from pf_tracker_ros.values import replace


@dataclasses.dataclass(frozen=True)
class Square:
    side: float
    name: str = "square"

    def __post_init__(self):
        if self.side < 0.0:
            raise ValueError(f"side is {self.side}")

    @cached_property
    def area(self):
        return self.side**2


def test_a_copy_has_the_other_fields_and_nothing_that_was_computed_from_them():
    square = Square(2.0)
    assert square.area == 4.0
    other = replace(square, side=3.0)
    assert other == dataclasses.replace(square, side=3.0) == Square(3.0)
    assert (other.area, square.side) == (9.0, 2.0)


def test_a_copy_is_checked_as_a_new_value_is():
    with pytest.raises(ValueError, match="side is -1"):
        replace(Square(2.0), side=-1.0)
    with pytest.raises(TypeError, match=r"Square has not all of \['width'\]"):
        replace(Square(2.0), width=3.0)
