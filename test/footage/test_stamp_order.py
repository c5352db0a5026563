"""The order of recorded images by their stamps."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.footage.bags import BagImage
from pf_tracker_ros.footage.stamp_order import WINDOW, StampOrder

SECOND = 1_000_000_000
STAMPS = [5 * SECOND + index * 40_000_000 for index in range(40)]


def images(stamps):
    return [BagImage(stamp, time, b"", None) for time, stamp in enumerate(stamps)]


def ordered(stamps):
    """The stamps in the order that comes out, and the number of moved images."""
    order = StampOrder()
    return [image.stamp for image in order.sort(images(stamps))], order.moved_count


@given(st.permutations(range(WINDOW + 1)))
def test_images_within_the_window_are_sorted(places):
    block = [STAMPS[10 + place] for place in places]
    stamps = STAMPS[:10] + block + STAMPS[10 + len(block) :]
    found, moved = ordered(stamps)
    assert found == STAMPS
    assert (moved > 0) == (stamps != STAMPS)


@given(st.lists(st.integers(0, 9) | st.integers(0, 20 * SECOND), max_size=40))
def test_every_image_comes_out_once(stamps):
    order = StampOrder()
    found = list(order.sort(images(stamps)))
    assert sorted(image.log_time for image in found) == list(range(len(stamps)))


def test_a_recording_that_starts_again_and_images_without_a_stamp_are_left_alone():
    stamps = [*STAMPS, *STAMPS, 0, 0, *STAMPS]
    assert ordered(stamps) == (stamps, 0)
    # Images of one stamp keep their order.
    same = StampOrder().sort(images([7, 7, 7, 5, 7]))
    assert [image.log_time for image in same] == [3, 0, 1, 2, 4]


def test_the_images_before_an_error_come_out():
    def failing():
        yield from images(STAMPS[:3])
        raise OSError("the disk is gone")

    found = StampOrder().sort(failing())
    assert [next(found).stamp for _ in range(3)] == STAMPS[:3]
    with pytest.raises(OSError, match="the disk is gone"):
        next(found)
