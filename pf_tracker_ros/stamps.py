"""Time stamps as integer nanoseconds, and their two fields in message headers; 0 is no stamp."""

from __future__ import annotations

from typing import Any

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""
LATE_WITHIN = NANOSECONDS
"""Largest age of a late image, nanoseconds; an older one is a jump of time."""


def split_stamp(stamp: int) -> tuple[int, int]:
    """Seconds and remaining nanoseconds of a stamp."""
    return divmod(stamp, NANOSECONDS)


def format_stamp(stamp: int) -> str:
    """A stamp as seconds with all digits."""
    seconds, nanoseconds = split_stamp(stamp)
    return f"{seconds}.{nanoseconds:09d}"


def join_stamp(seconds: int, nanoseconds: int) -> int:
    """Stamp of seconds and nanoseconds."""
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def stamp_of(header: Any) -> int:
    """The stamp of a std_msgs/Header."""
    return join_stamp(header.stamp.sec, header.stamp.nanosec)


def set_stamp(header: Any, stamp: int) -> None:
    """Set the stamp of a std_msgs/Header."""
    header.stamp.sec, header.stamp.nanosec = split_stamp(stamp)
