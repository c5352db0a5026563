"""What a localizer knows of a target: where it is expected, and that it is in another place."""

import math

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.hints import Hint, Standing
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.redetection import standing_boxes

STEP = 100_000_000
EXPECTED = (150.0, 60.0, 36.0, 60.0)


@pytest.fixture
def session():
    return Session(preset_parameters("default"), seed=0)


def show(session, image, number, hint=None):
    """Process a frame, with a hint of the one before; the estimate."""
    if hint:
        session.set_hints({1: hint}, 1 + (number - 1) * STEP)
    return session.process(Frame(image, 1 + number * STEP)).estimate


def hide(session, walkers):
    """Track the first walker for four frames, and hide it; the estimate of the last frame."""
    session.request(tuple(walkers.boxes[0][0]))
    for number in range(4):
        show(session, walkers.images[number], number)
    blank = np.full_like(walkers.images[0], 128)
    for number in range(4, 8):
        estimate = show(session, blank, number)
    assert estimate.state == "occluded"
    return estimate, blank


def test_a_hidden_target_is_looked_for_where_it_is_expected(session, walkers):
    """It stands there, in a larger size; without the hint it is not found in that frame."""
    _, image = hide(session, walkers)
    other = Session(preset_parameters("default"), seed=0)
    hide(other, walkers)
    left, top, width, height = map(int, walkers.boxes[0][0])
    seen = walkers.images[0][top : top + height, left : left + width]
    x, y, *size = map(int, EXPECTED)
    image[y : y + size[1], x : x + size[0]] = cv2.resize(seen, size)
    box = show(session, image, 8, Hint(None, EXPECTED, 3.0)).box
    assert box == pytest.approx(EXPECTED, abs=8.0)
    assert math.dist(show(other, image, 8).box[:2], EXPECTED[:2]) > 30.0


@pytest.mark.parametrize(
    "hint",
    [
        Hint(None, EXPECTED, 37.0),
        Hint(None, (400.0, 60.0, 36.0, 60.0), 3.0),
        # 1.65 images of 200 px.
        Hint(None, (50.0, -100.0, 200.0, 330.0), 3.0),
    ],
    ids=["vague", "outside", "too near"],
)
def test_a_vague_place_or_one_outside_of_the_image_or_too_near_says_nothing(session, walkers, hint):
    _, blank = hide(session, walkers)
    other = Session(preset_parameters("default"), seed=0)
    hide(other, walkers)
    assert show(session, blank, 8, hint).box == show(other, blank, 8).box


def test_a_tracked_target_is_left_to_the_image(session, walkers):
    session.request(tuple(walkers.boxes[0][0]))
    for number in range(4):
        show(session, walkers.images[number], number)
    estimate = show(session, walkers.images[4], 4, Hint(None, EXPECTED, 3.0))
    assert estimate.box[:2] == pytest.approx(walkers.boxes[4][0][:2], abs=4.0)


def test_another_place_counts_against_the_box_in_one_frame(session, walkers):
    """Of 3 to 1 odds, a log odds of -2 leaves 3 e^-2."""
    other = Session(preset_parameters("default"), seed=0)
    for one in (session, other):
        one.request(tuple(walkers.boxes[0][0]))
        for number in range(4):
            show(one, walkers.images[number], number)
    lowered = show(session, walkers.images[4], 4, Hint(place_odds=-2.0)).confidence
    plain = show(other, walkers.images[4], 4).confidence
    assert lowered < plain
    odds = [one / (1.0 - one) for one in (lowered, plain)]
    assert odds[0] == pytest.approx(odds[1] * math.exp(-2.0), rel=0.3)
    state = session._manager.get_track(1).filter_state
    assert state.place_factor == 1.0


@pytest.mark.parametrize(
    "hint",
    [
        Hint(1.5),
        Hint(None, (0.0, 0.0, 0.0, 10.0)),
        Hint(None, (0.0, math.nan, 10.0, 10.0)),
        Hint(None, EXPECTED, -1.0),
        Hint(None, None, 0.0, Standing(100.0, 0.0)),
        Hint(None, (0.0, 0.0, 1000.0, 10.0)),
        Hint(place_odds=math.inf),
    ],
)
def test_impossible_hints_are_refused(session, hint):
    with pytest.raises(ValueError, match="allowed"):
        session.set_hints({1: hint}, 1)


@pytest.mark.parametrize("preset", ["default", "li2007"])
def test_an_impossible_place_leaves_a_confidence(walkers, preset):
    session = Session(preset_parameters(preset), seed=0)
    session.request(tuple(walkers.boxes[0][0]))
    blank = np.full_like(walkers.images[0], 128)
    for number in range(4):
        estimate = show(session, blank, number, Hint(place_odds=-800.0))
        assert 0.0 <= estimate.confidence <= 1.0


def test_the_ground_counts_in_the_next_frame_only(walkers):
    once, always = (Session(preset_parameters("default"), seed=0) for _ in range(2))
    hint = Hint(standing=Standing(40.0, 2.0))
    boxes = {once: [], always: []}
    for session, seen in boxes.items():
        session.request(tuple(walkers.boxes[0][0]))
        for number in range(8):
            is_told = number == 1 or (number > 1 and session is always)
            seen.append(show(session, walkers.images[number], number, hint if is_told else None))
    assert [one.box for one in boxes[once][:2]] == [one.box for one in boxes[always][:2]]
    assert boxes[once][-1].box != boxes[always][-1].box


def test_windows_for_standing_targets_cover_the_image():
    """A camera at half the height of people: each box is centered on the horizon."""
    boxes = standing_boxes((640, 480), Standing(200.0, 2.0), 0.4, window=2.0)
    heights = sorted(set(boxes[:, 3].round(6)))
    assert len(heights) == 8
    # Somebody who stands near does not fit into the image.
    assert heights[-1] > 1.5 * 480.0
    assert boxes[:, 1] + boxes[:, 3] / 2 == pytest.approx(np.full(len(boxes), 200.0))
    for height in heights:
        one = boxes[boxes[:, 3].round(6) == height]
        reach = 0.5 * 2.0 * math.sqrt(0.4) * height
        centers = one[:, 0] + one[:, 2] / 2
        assert centers[0] - reach <= 0.0
        assert centers[-1] + reach >= 640.0
        assert (np.diff(centers) <= 2.0 * reach).all()
