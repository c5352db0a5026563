"""Affine motion and its Kalman filter, by hand."""

import numpy as np
import pytest

from pf_tracker_ros.filter import AffineMotion, Gaussian, KalmanFilter
from pf_tracker_ros.filter.affine_motion import AffineMotionParameters
from pf_tracker_ros.filter.kalman_filter import LinearStep

BOX = (100.0, 50.0, 40.0, 10.0)
BOX_SIZE = 20.0


def test_the_default_motion_is_noise_that_grows_with_the_root_of_time():
    parameters = AffineMotionParameters(position_noise=0.5, size_noise=0.2)
    states = np.tile([120.0, 55.0, 0.0], (40_000, 1))
    moved = AffineMotion(BOX, parameters).predict(states, 0.25, np.random.default_rng(0))
    np.testing.assert_allclose(moved.mean(axis=0), [120.0, 55.0, 0.0], atol=0.1)
    np.testing.assert_allclose(moved.std(axis=0), [5.0, 5.0, 0.1], rtol=0.02)


def still(**parameters):
    """Affine motion with almost no noise."""
    parameters = {"position_noise": 0.0, "size_noise": 0.0} | parameters
    return AffineMotion(BOX, AffineMotionParameters(**parameters))


@pytest.mark.parametrize(
    ("interval", "x", "y", "log_scale"),
    [
        # x_0 = (120, 55, 0), a = 1/2 and b = 0.04 s x 20 px x (25, -12.5) / s = (20, -10) a step:
        # offsets (40, 8, 0.4) -> (20, 4, 0.2) + b = (40, -6, 0.2), as a whole step ...
        (0.04, 160.0, 49.0, 0.2),
        # ... -> (20, -3, 0.1) + b as two ...
        (0.08, 160.0, 42.0, 0.1),
        # ... and the limit b / (1 - a) after a long time.
        (60.0, 160.0, 35.0, 0.0),
    ],
)
def test_affine_motion_by_hand(interval, x, y, log_scale):
    motion = still(factor=0.5, drift=(25.0, -12.5))
    states = np.array([[160.0, 63.0, 0.4]])
    moved = motion.predict(states, interval, np.random.default_rng(0))
    np.testing.assert_allclose(moved, [[x, y, log_scale]], atol=0.005)


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.2])
def test_two_half_steps_of_affine_motion_are_one(factor):
    motion = still(factor=factor, drift=(7.5, 0.0))
    states = np.array([[160.0, 63.0, 0.4]])
    half, whole = motion.transition(0.02), motion.transition(0.04)
    np.testing.assert_allclose(half.mean(half.mean(states)), whole.mean(states))
    matrix, control, _ = motion.linear_step(0.04)
    np.testing.assert_allclose(matrix[:3, :3] @ states[0] + control[:3], whole.mean(states)[0])


def test_the_kalman_filter_s_velocity_moves_the_particles():
    motion = still()
    belief = Gaussian([120.0, 55.0, 0.0, 30.0, -20.0, 0.0], 1e-6 * np.eye(6))
    kalman_filter = KalmanFilter(belief, motion).predict(0.1)
    np.testing.assert_allclose(kalman_filter.state.mean, [123.0, 53.0, 0.0])
    states = np.array([[160.0, 63.0, 0.4], [100.0, 50.0, 0.0]])
    # None are drawn from the prediction, all from the transition prior.
    proposed = kalman_filter.propose(states, 0.1, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(proposed.states, states + [3.0, -2.0, 0.0], atol=0.01)


def test_the_scale_keeps_center_and_aspect():
    boxes = AffineMotion(BOX, AffineMotionParameters()).boxes(
        np.array([[120.0, 55.0, np.log(2.0)]])
    )
    np.testing.assert_allclose(boxes, [[80.0, 45.0, 80.0, 20.0]])


def test_centers_and_sizes_stay_in_the_image():
    motion = AffineMotion(BOX, AffineMotionParameters())
    states = np.array([[-9.0, 900.0, 50.0], [900.0, -9.0, -50.0]])
    boxes = motion.boxes(motion.constrain(states, (160, 90)))
    np.testing.assert_allclose(boxes[0, 2:], [160.0, 40.0])
    np.testing.assert_allclose(boxes[1, 2:], [24.0, 6.0])
    np.testing.assert_allclose(boxes[:, :2] + boxes[:, 2:] / 2, [[0.0, 90.0], [160.0, 0.0]])


class OneColumn:
    """A position at constant velocity, without noise."""

    columns = ("x",)
    measured_columns = 1

    def linear_step(self, interval):
        return LinearStep(np.array([[1.0, interval], [0.0, 1.0]]), np.zeros(2), np.zeros(2))


def test_the_kalman_filter_predicts_and_corrects_by_hand():
    # One column and its velocity: 3 px and 2 px/s, half a second on 4 px with variance 1 + 4 / 4.
    kalman_filter = KalmanFilter(Gaussian([3.0, 2.0], np.diag([1.0, 4.0])), OneColumn())
    ahead = kalman_filter.predict(0.5)
    np.testing.assert_allclose(ahead.state.mean, [4.0])
    np.testing.assert_allclose(ahead.belief.covariance, [[2.0, 2.0], [2.0, 4.0]], atol=1e-5)
    # Measured at 8 with variance 2: gains 2 / 4 for the position and 2 / 4 for the velocity.
    corrected = ahead.correct(np.array([8.0]), np.array([[2.0]]))
    np.testing.assert_allclose(corrected.belief.mean, [6.0, 4.0], atol=1e-4)


def test_the_kalman_filter_predicts_a_steady_motion():
    kalman_filter = AffineMotion(BOX, AffineMotionParameters()).kalman_filter()
    for step in range(1, 30):
        at = np.array([120.0 + 3.0 * step, 55.0 - step, 0.0])
        ahead = kalman_filter.predict(0.04)
        kalman_filter = ahead.correct(at, np.diag([0.25, 0.25, 1e-4]))
    np.testing.assert_allclose(ahead.state.mean, at, atol=0.3)
    assert kalman_filter.belief.mean[3] == pytest.approx(75.0, rel=0.05)
