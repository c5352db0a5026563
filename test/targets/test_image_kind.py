"""Images of another kind than those of the targets, and targets drawn on them."""

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.requests import ImageFormatGuard, ManualTarget, ended_message

SECOND = 1_000_000_000
COLOR = np.zeros((60, 80, 3), np.uint8)
DEEP = np.zeros((60, 80), np.uint16)


def drawn(stamp, on_mismatch=False):
    return ManualTarget((1.0, 2.0, 30.0, 40.0), "new", stamp, on_mismatch)


@pytest.fixture
def kind():
    """Of color images, after three others at 2 s, 3 s and 4 s."""
    kind = ImageFormatGuard()
    kind.accept(Frame(COLOR, SECOND))
    for seconds in (2, 3, 4):
        kind.count_mismatch(seconds * SECOND)
    return kind


def test_a_refusal_tells_both_kinds(kind):
    assert kind.mismatch_message(DEEP) == (
        "image is (60, 80) uint16, but the targets are tracked in images of (60, 80, 3) uint8"
    )


def test_one_image_that_fits_takes_away_the_doubt(kind):
    assert kind.is_mismatched
    kind.count_match()
    assert not kind.is_mismatched
    assert not ImageFormatGuard().is_mismatched


def test_ten_images_in_a_row_that_do_not_fit_are_another_camera(kind):
    told = []
    for number in range(5, 13):
        told.append(kind.is_new_format)
        kind.count_mismatch(number * SECOND)
    assert told == [False] * 7 + [True]
    kind.count_match()
    kind.count_mismatch(13 * SECOND)
    assert not kind.is_new_format


@pytest.mark.parametrize(
    ("seconds", "expected"), [(1.9, False), (2, True), (3.5, True), (4, True), (4.1, False)]
)
def test_a_target_is_of_the_misfits_where_its_stamp_is_one_of_theirs(kind, seconds, expected):
    assert kind.is_on_mismatched_image(drawn(round(seconds * SECOND)), 4 * SECOND) is expected


@pytest.mark.parametrize("on_mismatch", [True, False])
def test_without_a_stamp_it_is_of_what_was_there_when_it_was_drawn(kind, on_mismatch):
    assert kind.is_on_mismatched_image(drawn(0, on_mismatch), 4 * SECOND) is on_mismatch


def test_misfits_begin_anew_after_one_that_fits(kind):
    kind.count_match()
    kind.count_mismatch(9 * SECOND)
    assert not kind.is_on_mismatched_image(drawn(3 * SECOND), 9 * SECOND)
    assert kind.is_on_mismatched_image(drawn(9 * SECOND), 9 * SECOND)


def test_images_that_come_in_disorder_count_from_the_earliest(kind):
    kind.count_mismatch(1 * SECOND)
    assert kind.is_on_mismatched_image(drawn(1 * SECOND), 4 * SECOND)


def test_targets_of_the_last_second_of_misfits_begin_on_the_image_at_hand(kind):
    stamps = [SECOND, 2 * SECOND, 3 * SECOND, 4 * SECOND, 5 * SECOND]
    brought = kind.moved_to_current([drawn(stamp) for stamp in stamps], 4 * SECOND)
    assert brought == [drawn(stamp) for stamp in [SECOND, 2 * SECOND, 0, 0, 5 * SECOND]]


def test_targets_that_end_are_named():
    assert ended_message([1, 12]).startswith("ended: 1, 12; a new target was drawn on images of")


@pytest.mark.parametrize(
    ("size", "shape", "box"),
    [
        ((80, 60), (120, 160), (2.0, 4.0, 60.0, 80.0)),
        ((80, 60), (120, 200), (1.0, 2.0, 30.0, 40.0)),
        (None, (120, 160), (1.0, 2.0, 30.0, 40.0)),
    ],
    ids=["scaled", "another aspect ratio", "not begun"],
)
def test_what_is_drawn_again_is_scaled_where_the_image_is(size, shape, box):
    one = drawn(5 * SECOND, on_mismatch=True)._replace(image_size=size)
    for is_selected in (False, True):
        drawn_again = one.redraw(np.zeros(shape, np.uint8), is_selected=is_selected)
        assert drawn_again == ManualTarget(box, "new", 0, is_selected=is_selected)


def test_what_was_drawn_on_images_of_another_kind_is_told_apart_to_the_nanosecond():
    kind = ImageFormatGuard()
    for image, stamp in ((COLOR, 7), (COLOR, 8), (DEEP, 9), (DEEP, 10)):
        kind.accept(Frame(image, stamp))
    assert [kind.is_before_change(stamp) for stamp in (0, 7, 8, 9, 10, 11)] == [
        *(False, True, True),
        *(False, False, False),
    ]
    with pytest.raises(
        ValueError, match=r"another size or type; draw it on one like the last, \(60, 80\) uint16"
    ):
        kind.check_manual_target(drawn(8))
    kind.check_manual_target(drawn(9))
    kind.check_manual_target(drawn(0))


def test_where_time_goes_back_nobody_knows_of_images_before():
    kind = ImageFormatGuard()
    for image, stamp in ((COLOR, 7), (DEEP, 9), (DEEP, 5)):
        kind.accept(Frame(image, stamp))
    assert not kind.is_before_change(6)
