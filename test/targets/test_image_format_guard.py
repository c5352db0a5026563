"""Images of another size or type than those of the targets, and manual targets on them."""

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.requests import ImageFormatGuard, ManualTarget

SECOND = 1_000_000_000
COLOR = np.zeros((60, 80, 3), np.uint8)
DEEP = np.zeros((60, 80), np.uint16)


def manual(stamp, on_mismatch=False):
    return ManualTarget((1.0, 2.0, 30.0, 40.0), "new", stamp, on_mismatch)


@pytest.fixture
def guard():
    """Of color images, after three mismatched ones at 2 s, 3 s and 4 s."""
    guard = ImageFormatGuard()
    guard.accept(Frame(COLOR, SECOND))
    for seconds in (2, 3, 4):
        guard.count_mismatch(seconds * SECOND)
    return guard


def test_a_matching_image_resets_the_count(guard):
    assert guard.is_mismatched
    guard.count_match()
    assert not guard.is_mismatched
    assert not ImageFormatGuard().is_mismatched


def test_ten_mismatched_images_in_a_row_are_a_new_format(guard):
    is_new = []
    for number in range(5, 13):
        is_new.append(guard.is_new_format)
        guard.count_mismatch(number * SECOND)
    assert is_new == [False] * 7 + [True]
    guard.count_match()
    guard.count_mismatch(13 * SECOND)
    assert not guard.is_new_format


@pytest.mark.parametrize(
    ("seconds", "expected"), [(1.9, False), (2, True), (3.5, True), (4, True), (4.1, False)]
)
def test_a_target_with_the_stamp_of_a_mismatched_image_is_on_it(guard, seconds, expected):
    assert guard.is_on_mismatched_image(manual(round(seconds * SECOND)), 4 * SECOND) is expected


@pytest.mark.parametrize("on_mismatch", [True, False])
def test_a_target_without_a_stamp_is_on_the_images_of_its_request(guard, on_mismatch):
    assert guard.is_on_mismatched_image(manual(0, on_mismatch), 4 * SECOND) is on_mismatch


def test_mismatched_images_before_a_matching_one_do_not_count(guard):
    guard.count_match()
    guard.count_mismatch(9 * SECOND)
    assert not guard.is_on_mismatched_image(manual(3 * SECOND), 9 * SECOND)
    assert guard.is_on_mismatched_image(manual(9 * SECOND), 9 * SECOND)


def test_mismatched_images_out_of_order_count_from_the_earliest(guard):
    guard.count_mismatch(1 * SECOND)
    assert guard.is_on_mismatched_image(manual(1 * SECOND), 4 * SECOND)


def test_targets_on_mismatched_images_of_the_last_second_move_to_the_current_one(guard):
    stamps = [SECOND, 2 * SECOND, 3 * SECOND, 4 * SECOND, 5 * SECOND]
    moved = guard.moved_to_current([manual(stamp) for stamp in stamps], 4 * SECOND)
    assert moved == [manual(stamp) for stamp in [SECOND, 2 * SECOND, 0, 0, 5 * SECOND]]


@pytest.mark.parametrize(
    ("size", "shape", "box"),
    [
        ((80, 60), (120, 160), (2.0, 4.0, 60.0, 80.0)),
        ((80, 60), (120, 200), (1.0, 2.0, 30.0, 40.0)),
        (None, (120, 160), (1.0, 2.0, 30.0, 40.0)),
    ],
    ids=["scaled", "another aspect ratio", "not begun"],
)
def test_a_restarted_target_is_scaled_with_the_image(size, shape, box):
    one = manual(5 * SECOND, on_mismatch=True)._replace(image_size=size)
    for is_selected in (False, True):
        redrawn = one.redraw(np.zeros(shape, np.uint8), is_selected=is_selected)
        assert redrawn == ManualTarget(box, "new", 0, is_selected=is_selected)


def test_the_change_of_format_is_exact_to_the_nanosecond():
    guard = ImageFormatGuard()
    for image, stamp in ((COLOR, 7), (COLOR, 8), (DEEP, 9), (DEEP, 10)):
        guard.accept(Frame(image, stamp))
    assert [guard.is_before_change(stamp) for stamp in (0, 7, 8, 9, 10, 11)] == [
        *(False, True, True),
        *(False, False, False),
    ]
    with pytest.raises(
        ValueError, match=r"another size or type; draw it on one like the last, \(60, 80\) uint16"
    ):
        guard.check_manual_target(manual(8))
    guard.check_manual_target(manual(9))
    guard.check_manual_target(manual(0))


def test_a_jump_back_resets_the_change_of_format():
    guard = ImageFormatGuard()
    for image, stamp in ((COLOR, 7), (DEEP, 9), (DEEP, 5)):
        guard.accept(Frame(image, stamp))
    assert not guard.is_before_change(6)


def test_after_a_jump_to_the_same_stamp_there_is_no_former_format():
    """As where one recording is played after another, and both begin at the same stamp."""
    guard = ImageFormatGuard()
    guard.accept(Frame(COLOR, SECOND))
    guard.accept(Frame(DEEP, SECOND))
    guard.check_manual_target(manual(SECOND))
    guard.accept(Frame(COLOR, 2 * SECOND))
    with pytest.raises(ValueError, match="another size or type"):
        guard.check_manual_target(manual(SECOND))
