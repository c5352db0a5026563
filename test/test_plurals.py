"""Counts with singular and plural nouns."""

from pf_tracker_ros.plurals import counted


def test_one_is_singular():
    assert [counted(count, "frame") for count in range(3)] == ["0 frames", "1 frame", "2 frames"]
    assert [counted(count, "box", "boxes") for count in (1, 2)] == ["1 box", "2 boxes"]
