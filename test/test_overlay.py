import itertools

import cv2
import numpy as np
import pytest
from common import make_estimate, run_python

from pf_tracker_ros.overlay import STATE_COLORS, draw_multi_target, draw_overlay
from pf_tracker_ros.targets.tracked_target import TrackedTarget

HEIGHT, WIDTH = 288, 384
GRAY = 90


def estimate_with(
    state="tracking", box=(100.0, 80.0, 60.0, 50.0), centers=((130, 105),), weights=(1.0,)
):
    centers = np.array(centers, np.float64)
    boxes = np.hstack([centers - [30, 25], np.tile([60.0, 50.0], (len(centers), 1))])
    return make_estimate(box, state, particle_boxes=boxes, weights=np.array(weights))


@pytest.fixture
def plain():
    return np.full((HEIGHT, WIDTH, 3), GRAY, np.uint8)


def white_pixels(overlay, left, top, right, bottom):
    return int((overlay[top:bottom, left:right] == 255).all(axis=2).sum())


@pytest.mark.parametrize("state", STATE_COLORS)
def test_the_box_is_drawn_at_its_place_in_the_color_of_the_state(plain, state):
    overlay = draw_overlay(plain, estimate_with(state))
    for row, column in [(80, 130), (129, 130), (105, 100), (105, 159)]:
        assert tuple(overlay[row, column]) == STATE_COLORS[state]
    for row, column in [(75, 130), (135, 130), (105, 95), (105, 165), (90, 115)]:
        assert tuple(overlay[row, column]) == (GRAY, GRAY, GRAY)


def test_the_input_is_not_drawn_into(plain):
    before = plain.copy()
    plain.flags.writeable = False
    overlay = draw_overlay(plain, estimate_with(), "tracking 0.50")
    assert np.array_equal(plain, before)
    assert not np.shares_memory(overlay, plain)


def test_a_heavier_particle_is_a_larger_box_around_its_center(plain):
    estimate = estimate_with(
        box=(300.0, 200.0, 60.0, 50.0),
        centers=((50, 50), (100, 50), (150, 50)),
        weights=(0.1, 0.3, 0.6),
    )
    overlay = draw_overlay(plain, estimate)
    light, medium, heavy = (white_pixels(overlay, x - 20, 30, x + 20, 70) for x in (50, 100, 150))
    assert 0 < light < medium < heavy
    rows, columns = np.nonzero((overlay[30:70, 130:170] == 255).all(axis=2))
    assert rows.mean() + 30 == pytest.approx(50, abs=1)
    assert columns.mean() + 130 == pytest.approx(150, abs=1)


def test_the_text_stands_at_the_top_left(plain):
    overlay = draw_overlay(plain, None, "no target")
    changed = np.argwhere((overlay != plain).any(axis=2))
    assert len(changed) > 50
    assert changed[:, 0].max() < 40
    assert np.array_equal(draw_overlay(plain, None), plain)


def test_a_text_that_cannot_be_encoded_is_drawn_with_a_question_mark():
    """In another process, which OpenCV would abort."""
    program = """
import numpy as np
from pf_tracker_ros.overlay import draw_overlay
image = np.zeros((48, 160, 3), np.uint8)
drawn = draw_overlay(image, None, "car \\ud800")
assert (drawn == draw_overlay(image, None, "car ?")).all()
"""
    run_python(program, check=True)


def test_captions_of_neighbors_do_not_cover_each_other(monkeypatch, plain):
    written = []
    monkeypatch.setattr(cv2, "putText", lambda canvas, text, *rest: written.append((text, rest)))
    boxes = [(100.0, 200.0, 20.0, 40.0), (110.0, 195.0, 20.0, 40.0), (105.0, 205.0, 20.0, 40.0)]
    labels = ["person", "person", "\udc80"]
    targets = [
        TrackedTarget(id, label, estimate_with(box=box), 1.0, 0.0)
        for id, (label, box) in enumerate(zip(labels, boxes, strict=True), start=1)
    ]
    draw_multi_target(plain, targets)
    areas = {}
    for text, (origin, font, size, *_) in written:
        (width, height), _ = cv2.getTextSize(text, font, size, 1)
        areas[text] = (origin[0], origin[0] + width, origin[1] - height, origin[1])
    assert list(areas) == ["1 person", "2 person", "3 ?"]
    for (left, right, top, bottom), other in itertools.combinations(areas.values(), 2):
        assert right <= other[0] or other[1] <= left or bottom <= other[2] or other[3] <= top
    # The first one stays above its box.
    assert areas["1 person"][0] == 100
    assert 190 < areas["1 person"][3] < 200


def test_a_caption_at_the_right_edge_is_as_whole_as_elsewhere(plain):
    def caption(x):
        target = TrackedTarget(2, "person", estimate_with(box=(x, 200.0, 40.0, 60.0)), 1.0, 0.0)
        drawn = draw_multi_target(plain, [target])[170:197]
        columns = np.flatnonzero((drawn != GRAY).any(axis=(0, 2)))
        return drawn[:, columns[0] : columns[-1] + 1]

    # Beside the particle.
    whole = caption(200.0)
    assert whole.shape[1] > 40
    for x in (WIDTH - 20.0, WIDTH + 50.0):
        assert np.array_equal(caption(x), whole)


def test_gray_becomes_the_same_gray_in_color():
    gray = np.arange(HEIGHT * WIDTH, dtype=np.uint32).astype(np.uint8).reshape(HEIGHT, WIDTH)
    overlay = draw_overlay(gray, None)
    assert overlay.shape == (HEIGHT, WIDTH, 3)
    assert (overlay == gray[..., None]).all()


@pytest.mark.parametrize(
    ("low", "high", "kind"), [(20000, 21000, np.uint16), (290, 291, np.float32)]
)
def test_more_bits_are_stretched_over_8_without_reversing_any_order(low, high, kind):
    thermal = np.linspace(low, high, HEIGHT * WIDTH).astype(kind).reshape(HEIGHT, WIDTH)
    gray = draw_overlay(thermal, None)[..., 0].ravel().astype(int)
    assert (gray[0], gray[-1]) == (0, 255)
    assert (np.diff(gray) >= 0).all()
    assert len(np.unique(gray)) > 200
    if kind == np.float32:
        thermal[0, 0], thermal[0, 1] = np.nan, np.inf
        drawn = draw_overlay(thermal, None)[..., 0].ravel()
        np.testing.assert_allclose(drawn[2:], gray[2:], rtol=0, atol=2)


@pytest.mark.parametrize("value", [0.0, 300.0, -1e30, np.nan, np.inf, np.uint16(30000)])
def test_a_constant_image_can_be_drawn(value):
    kind = np.uint16 if isinstance(value, np.uint16) else np.float32
    assert draw_overlay(np.full((20, 30), value, kind), None).shape == (20, 30, 3)
    # Likewise the smallest one.
    smallest = draw_overlay(np.zeros((1, 1), np.uint8), estimate_with(), "tracking")
    assert smallest.shape == (1, 1, 3)


@pytest.mark.parametrize(
    "box", [(-1e9, -1e9, 10.0, 10.0), (1e12, 50.0, 5.0, 5.0), (-1e9, -1e9, 2e9, 2e9)]
)
def test_a_box_whose_edges_are_far_outside_leaves_the_image_alone(plain, box):
    estimate = estimate_with(box=box, centers=((-1e9, 1e9),))
    assert np.array_equal(draw_overlay(plain, estimate), plain)
