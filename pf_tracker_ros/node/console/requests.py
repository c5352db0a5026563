"""Validation of browsers' requests."""

from __future__ import annotations

from typing import Any

from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.stamps import NANOSECONDS

_MAX_COORDINATE = 1e6
# The seconds of a stamp are a signed 32-bit number.
_MAX_STAMP = 2**31 * NANOSECONDS


class RequestError(ValueError):
    """A request is invalid; the message says why."""


def is_number(value: Any) -> bool:
    """Whether a value from JSON or YAML is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def numbers_of(message: Json, name: str, count: int) -> list[float]:
    """A list of `count` numbers of a request.

    Raises:
        RequestError: It has another number of them, or values that cannot be pixels.
    """
    values = message.get(name)
    if not isinstance(values, list) or len(values) != count or not all(map(is_number, values)):
        raise RequestError(f"'{name}' has to be a list of {count} numbers")
    if not all(abs(one) <= _MAX_COORDINATE for one in values):
        raise RequestError(f"'{name}' has a number above {_MAX_COORDINATE:g}")
    return [float(one) for one in values]


def number_of(message: Json, name: str) -> float:
    """A number of a request; raises as `numbers_of`."""
    (value,) = numbers_of({name: [message.get(name)]}, name, 1)
    return value


def boolean_of(message: Json, name: str) -> bool:
    """A Boolean of a request.

    Raises:
        RequestError: It is none.
    """
    value = message.get(name)
    if not isinstance(value, bool):
        raise RequestError(f"'{name}' has to be true or false")
    return value


def integer_of(message: Json, name: str) -> int:
    """A non-negative integer of a request.

    Raises:
        RequestError: It is none.
    """
    value = message.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise RequestError(f"'{name}' has to be a whole number from 0 on")
    return value


def stamp_in(message: Json) -> int:
    """The stamp of a request, nanoseconds; sent as text, as JavaScript's numbers are too short.

    Raises:
        RequestError: It has none.
    """
    text = message.get("stamp")
    if not isinstance(text, str) or not text.isascii() or not text.isdigit() or len(text) > 19:
        raise RequestError("'stamp' has to be a text of digits, nanoseconds")
    if int(text) >= _MAX_STAMP:
        raise RequestError("'stamp' is beyond the range of ROS time")
    return int(text)
