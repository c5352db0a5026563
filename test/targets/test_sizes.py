"""The size of the box keeps up with a target that comes near or walks off."""

import math

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.hints import Hint, Standing
from pf_tracker_ros.tracking.presets import preset_parameters

SIDE, STILL, MOVING, AFTERWARDS = 40.0, 10, 12, 10
STAMP = NANOSECONDS // 20
ON_GROUND = Hint(standing=Standing(horizon=60.0, slope=1.0))


def shown(side, seed):
    """A textured square of a side in the middle of a textured image."""
    generator = np.random.default_rng(seed)
    image = cv2.resize(generator.integers(60, 160, (30, 40, 3), np.uint8), (320, 240))
    target = cv2.resize(generator.integers(0, 255, (8, 8, 3), np.uint8), (256, 256))
    left, top = np.array([160, 120]) - side // 2
    image[top : top + side, left : left + side] = cv2.resize(
        target, (side, side), interpolation=cv2.INTER_AREA
    )
    return image


def errors_of(growth, seed, hint, *, is_detected):
    """Logarithms of the box's height over the true one, while the target moves and afterwards.

    A detector sees the target in the first two frames, if at all.
    """
    session = Session(preset_parameters("default"), seed)
    box = (160 - SIDE / 2, 120 - SIDE / 2, SIDE, SIDE)
    session.request(box)
    if is_detected:
        for number in range(2):
            session.add_detections(Detections([box], [0.9]), STAMP * (number + 1))
    errors = []
    for number in range(STILL + MOVING + AFTERWARDS):
        side = round(SIDE * growth ** min(max(number - STILL, 0), MOVING))
        outcome = session.process(Frame(shown(side, seed), STAMP * (number + 1)))
        session.set_hints({outcome.selected: hint}, STAMP * (number + 1))
        errors.append(math.log(outcome.targets[0].estimate.box[3] / side))
    return np.abs(errors[STILL:])


@pytest.mark.parametrize("growth", [1.03, 1 / 1.03])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("is_detected", [False, True])
def test_where_the_ground_is_known_a_size_keeps_up_with_somebody_who_walks(
    growth, seed, is_detected
):
    """A person at 2 m comes nearer by 1.2 m/s, at 20 frames a second.

    The same while a detector that has seen the target misses it for a second.
    """
    known, unknown = (
        errors_of(growth, seed, hint, is_detected=is_detected) for hint in (ON_GROUND, Hint())
    )
    assert known.max() < unknown.max()
    assert known.max() < 0.15
    assert known[-1] < 0.08


def estimates_of(delay):
    """Of somebody who comes near, with detections so many frames late; after each of them."""
    session = Session(preset_parameters("default"), 0)
    session.frame_buffer.limit(30, 200.0)
    box = (160 - SIDE / 2, 120 - SIDE / 2, SIDE, SIDE)
    session.request(box)
    estimates = []
    for number in range(16):
        if number - delay in (1, 4, 8):
            session.add_detections(Detections([box], [0.9]), STAMP * (number - delay + 1))
        side = round(SIDE * 1.03 ** max(number - 9, 0))
        outcome = session.process(Frame(shown(side, 0), STAMP * (number + 1)))
        session.set_hints({outcome.selected: ON_GROUND}, STAMP * (number + 1))
        estimates.append(outcome.estimate.box)
    return estimates[11:]


def test_late_detections_leave_a_size_as_those_in_time_do():
    assert estimates_of(3) == estimates_of(0)
