"""Stamps: whole nanoseconds, as the headers of messages hold them in two fields; 0 is no stamp."""

from __future__ import annotations

from typing import Any

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""


def parts(stamp: int) -> tuple[int, int]:
    """A stamp as whole seconds and the nanoseconds beyond them."""
    return divmod(stamp, NANOSECONDS)


def join(seconds: int, nanoseconds: int) -> int:
    """The stamp of whole seconds and nanoseconds beyond them."""
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def stamp_of(header: Any) -> int:
    """The stamp of a std_msgs/Header."""
    return join(header.stamp.sec, header.stamp.nanosec)


def set_stamp(header: Any, stamp: int) -> None:
    """Put a stamp into a std_msgs/Header."""
    header.stamp.sec, header.stamp.nanosec = parts(stamp)
