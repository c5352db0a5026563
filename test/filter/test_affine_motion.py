"""Affine motion and the Kalman filter ahead of it, by hand."""

import numpy as np
import pytest

from pf_tracker_ros.filter import AffineMotion, Gaussian, KalmanForesight, MotionParameters

BOX = (100.0, 50.0, 40.0, 10.0)
BOX_SIZE = 20.0


def test_particles_stay_put_but_for_noise_that_grows_with_the_root_of_time():
    parameters = MotionParameters(position_noise=0.5, size_noise=0.2)
    states = np.tile([120.0, 55.0, 0.0], (40_000, 1))
    moved = AffineMotion(BOX, parameters).predict(states, 0.25, np.random.default_rng(0))
    np.testing.assert_allclose(moved.mean(axis=0), [120.0, 55.0, 0.0], atol=0.1)
    np.testing.assert_allclose(moved.std(axis=0), [5.0, 5.0, 0.1], rtol=0.02)


def test_the_scale_keeps_center_and_aspect():
    boxes = AffineMotion(BOX, MotionParameters()).boxes(np.array([[120.0, 55.0, np.log(2.0)]]))
    np.testing.assert_allclose(boxes, [[80.0, 45.0, 80.0, 20.0]])


def test_centers_and_sizes_stay_in_the_image():
    motion = AffineMotion(BOX, MotionParameters())
    states = np.array([[-9.0, 900.0, 50.0], [900.0, -9.0, -50.0]])
    boxes = motion.boxes(motion.constrained(states, (160, 90)))
    np.testing.assert_allclose(boxes[0, 2:], [160.0, 40.0])
    np.testing.assert_allclose(boxes[1, 2:], [24.0, 6.0])
    np.testing.assert_allclose(boxes[:, :2] + boxes[:, 2:] / 2, [[0.0, 90.0], [160.0, 0.0]])


def test_the_kalman_filter_predicts_and_corrects_by_hand():
    # One column and its velocity: 3 px and 2 px/s, half a second on 4 px with variance 1 + 4 / 4.
    belief = Gaussian([3.0, 2.0], np.diag([1.0, 4.0]))
    foresight = KalmanForesight(
        belief, np.zeros(2), AffineMotion(BOX, MotionParameters()).transition
    )
    ahead = foresight.predicted(0.5)
    np.testing.assert_allclose(ahead.state.mean, [4.0])
    np.testing.assert_allclose(ahead.belief.covariance, [[2.0, 2.0], [2.0, 4.0]], atol=1e-5)
    # Measured at 8 with variance 2: gains 2 / 4 for the position and 2 / 4 for the velocity.
    corrected = ahead.corrected(np.array([8.0]), np.array([[2.0]]))
    np.testing.assert_allclose(corrected.belief.mean, [6.0, 4.0], atol=1e-4)


def test_a_steady_motion_is_foreseen():
    foresight = AffineMotion(BOX, MotionParameters()).foresight()
    for step in range(1, 30):
        at = np.array([120.0 + 3.0 * step, 55.0 - step, 0.0])
        ahead = foresight.predicted(0.04)
        foresight = ahead.corrected(at, np.diag([0.25, 0.25, 1e-4]))
    np.testing.assert_allclose(ahead.state.mean, at, atol=0.3)
    assert foresight.belief.mean[3] == pytest.approx(75.0, rel=0.05)
