"""Time stamps and their two fields in message headers."""

from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.stamps import NANOSECONDS, join_stamp, set_stamp, split_stamp, stamp_of

# Range of builtin_interfaces/Time.
stamps = st.integers(-(2**31) * NANOSECONDS, 2**31 * NANOSECONDS - 1)


@given(stamps)
def test_a_stamp_and_its_parts_are_the_same_time(stamp):
    seconds, nanoseconds = split_stamp(stamp)
    assert -(2**31) <= seconds < 2**31
    assert 0 <= nanoseconds < NANOSECONDS
    assert join_stamp(seconds, nanoseconds) == stamp
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    set_stamp(header, stamp)
    assert stamp_of(header) == stamp
