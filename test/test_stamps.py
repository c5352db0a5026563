"""Stamps and the two fields that headers hold them in."""

from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.stamps import NANOSECONDS, join, parts, set_stamp, stamp_of

# What the fields of builtin_interfaces/Time can hold.
stamps = st.integers(-(2**31) * NANOSECONDS, 2**31 * NANOSECONDS - 1)


@given(stamps)
def test_a_stamp_and_its_parts_are_the_same_time(stamp):
    seconds, nanoseconds = parts(stamp)
    assert -(2**31) <= seconds < 2**31
    assert 0 <= nanoseconds < NANOSECONDS
    assert join(seconds, nanoseconds) == stamp


@given(stamps)
def test_a_header_gives_back_the_stamp_that_it_was_given(stamp):
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    set_stamp(header, stamp)
    assert stamp_of(header) == stamp
