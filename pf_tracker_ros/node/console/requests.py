"""What browsers ask for, checked before it is done."""

from __future__ import annotations

from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.stamps import NANOSECONDS

_LARGEST_COORDINATE = 1e6
# The seconds of a stamp are a 32-bit number with a sign.
_LATEST_STAMP = 2**31 * NANOSECONDS


class RequestError(ValueError):
    """A browser asked for what cannot be; the message says why."""


def numbers_of(message: Json, name: str, count: int) -> list[float]:
    """So many numbers of a request.

    Raises:
        RequestError: It has not so many, or others than can be pixels.
    """
    values = message.get(name)
    if (
        not isinstance(values, list)
        or len(values) != count
        or any(isinstance(one, bool) or not isinstance(one, int | float) for one in values)
    ):
        raise RequestError(f"'{name}' has to be a list of {count} numbers")
    if not all(abs(one) <= _LARGEST_COORDINATE for one in values):
        raise RequestError(f"'{name}' has numbers beyond {_LARGEST_COORDINATE:g}")
    return [float(one) for one in values]


def number_of(message: Json, name: str) -> float:
    """One number of a request; raises as `numbers_of`."""
    (value,) = numbers_of({name: [message.get(name)]}, name, 1)
    return value


def boolean_of(message: Json, name: str) -> bool:
    """A yes or no of a request.

    Raises:
        RequestError: It is neither.
    """
    value = message.get(name)
    if not isinstance(value, bool):
        raise RequestError(f"'{name}' has to be true or false")
    return value


def integer_of(message: Json, name: str) -> int:
    """A whole number from 0 on of a request.

    Raises:
        RequestError: It is none.
    """
    value = message.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise RequestError(f"'{name}' has to be a whole number from 0 on")
    return value


def stamp_in(message: Json) -> int:
    """The stamp of a request, nanoseconds; text, because JavaScript's numbers do not hold it.

    Raises:
        RequestError: It has none.
    """
    text = message.get("stamp")
    if not isinstance(text, str) or not text.isascii() or not text.isdigit() or len(text) > 19:
        raise RequestError("'stamp' has to be a text of digits, nanoseconds")
    if int(text) >= _LATEST_STAMP:
        raise RequestError("'stamp' is later than ROS has a time for")
    return int(text)
