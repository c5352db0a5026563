"""A camera that repeats one image under new stamps."""

import numpy as np
import pytest

from pf_tracker_ros import Detections
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters

START = 1_700_000_000_000_000_000
STEP = 40_000_000


def at(number):
    return START + number * STEP


@pytest.fixture
def session(moving_square):
    """A session that has tracked through frames 0 to 2."""
    session = Session({**preset_parameters("li2007"), "particles": 50}, seed=1)
    session.frozen_after = 0.5
    session.frame_buffer.limit(200, 64.0)
    session.request(moving_square.boxes[0])
    for number in range(3):
        show(session, moving_square.images[number], at(number))
    return session


def show(session, image, stamp):
    # Each message has an array of its own.
    return session.process(Frame(image.copy(), stamp))


def freeze(session, image, numbers=range(3, 20)):
    """Repeat an image; returns the outcomes."""
    return [show(session, image, at(number)).frame for number in numbers]


def test_equal_images_are_frozen_after_half_a_second(session, moving_square):
    found = freeze(session, moving_square.images[2])
    assert found == ["tracked"] * 12 + ["frozen"] * 5
    outcome = show(session, moving_square.images[2], at(20))
    assert [target.id for target in outcome.targets] == [1]
    assert outcome.targets == session.targets


def test_the_first_image_that_differs_is_tracked_over_the_whole_time(
    session, moving_square, monkeypatch
):
    intervals, update = [], session._manager.update

    def noted(frame, interval, *due, **named):
        intervals.append(interval)
        update(frame, interval, *due, **named)

    monkeypatch.setattr(session._manager, "update", noted)
    freeze(session, moving_square.images[2])
    changed = moving_square.images[2].copy()
    changed[-1, -1, -1] ^= 1
    assert show(session, changed, at(20)).frame == "tracked"
    # From frame 14, the last one that was tracked.
    assert intervals[-1] == pytest.approx(6 * 0.04)
    # The time of the frozen images counts anew.
    assert freeze(session, changed, range(21, 34)) == ["tracked"] * 12 + ["frozen"]


def test_stamps_decide_about_the_time(session, moving_square):
    image = moving_square.images[2]
    numbers = [2 + index / 10 for index in range(1, 100)]
    assert {show(session, image, round(at(n))).frame for n in numbers} == {"tracked"}
    assert show(session, image, at(30)).frame == "frozen"


def test_images_without_stamps_are_an_interval_apart(session, moving_square):
    found = [show(session, moving_square.images[2], 0).frame for _ in range(14)]
    assert found == ["tracked"] * 12 + ["frozen"] * 2


def test_the_same_stamp_is_a_duplicate_not_frozen(session, moving_square):
    """As of a recording that stands still."""
    found = [show(session, moving_square.images[2], at(2)).frame for _ in range(100)]
    assert found == ["duplicate"] * 100


def test_after_a_jump_back_the_time_counts_anew(session, moving_square):
    image = moving_square.images[2]
    freeze(session, image)
    assert show(session, image, START - 10**10).frame == "tracked"
    assert show(session, image, START - 10**10 + STEP).frame == "tracked"


def test_a_target_starts_on_a_frozen_image(session, moving_square):
    freeze(session, moving_square.images[2])
    session.request(moving_square.boxes[2], at(20))
    assert show(session, moving_square.images[2], at(20)).frame == "started"
    assert show(session, moving_square.images[2], at(21)).frame == "frozen"


def test_detections_of_frozen_images_have_no_effect(moving_square):
    session = Session(preset_parameters("default", 8), seed=1)
    session.frozen_after = 0.5
    image = moving_square.images[0]
    freeze(session, image, range(20))
    session.add_detections(Detections([moving_square.boxes[0]], [0.9]), at(19))
    assert show(session, moving_square.images[1], at(20)).targets == ()


def test_zero_never_freezes_and_a_change_applies_at_once(session, moving_square):
    session.frozen_after = 0.0
    image = moving_square.images[2]
    assert set(freeze(session, image, range(3, 50))) == {"tracked"}
    session.frozen_after = 0.1
    assert freeze(session, image, range(50, 54)) == ["tracked"] * 3 + ["frozen"]


@pytest.mark.parametrize("type", [np.uint8, np.uint16, np.float32])
def test_noise_of_one_level_is_not_frozen(type):
    session = Session(preset_parameters("default"), seed=1)
    session.frozen_after = 0.1
    image = np.full((48, 64), 100, type)
    for number in range(20):
        image[number, number] += 1
        assert show(session, image, at(number)).frame == "waiting"
    assert freeze(session, image, range(20, 24)) == ["waiting"] * 2 + ["frozen"] * 2
