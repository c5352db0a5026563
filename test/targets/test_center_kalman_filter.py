import numpy as np
import pytest

from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter

INTERVAL = 0.1
HEIGHT = 100.0
STD = np.array([6.0, 10.0])


def filtered(centers):
    """The filter after measured centers, one per interval."""
    first = np.asarray(centers[0], float)
    kalman = CenterKalmanFilter.initiate(np.array([*(first - (20.0, 50.0)), 40.0, HEIGHT]), STD)
    for center in centers[1:]:
        kalman = kalman.predict(INTERVAL, HEIGHT).correct(np.asarray(center, float), STD)
    return kalman


def test_a_walking_target_is_predicted_farther_on():
    draw = np.random.default_rng(3)
    steps = np.arange(60)
    true = np.stack([100 + 5.0 * steps, 200 - 2.0 * steps], axis=1)
    kalman = filtered(true + draw.normal(size=true.shape) * (3.0, 4.0))
    for _ in range(10):
        kalman = kalman.predict(INTERVAL, HEIGHT)
    assert kalman.center == pytest.approx(true[-1] + 10 * np.array([5.0, -2.0]), abs=12.0)


def test_the_variance_grows_without_measurements():
    kalman = filtered([(100, 200)] * 20)
    variances = [kalman.center_variance]
    for _ in range(10):
        kalman = kalman.predict(INTERVAL, HEIGHT)
        variances.append(kalman.center_variance)
    assert (np.diff(variances, axis=0) > 0).all()
    assert (np.diff(variances, 2, axis=0) > 0).all()


def test_after_a_pause_the_center_stays_and_the_variance_grows_for_ten_seconds():
    kalman = filtered([(100 + 8.0 * step, 200) for step in range(30)])
    center, variances = kalman.center, []
    assert kalman.velocity[0] == pytest.approx(80.0, rel=0.1)
    moved = kalman.predict(2.0, HEIGHT)
    assert moved.center == pytest.approx(center + 2.0 * kalman.velocity)
    for pause in (2.5, 5.0, 10.0, 1e9):
        paused = kalman.predict(pause, HEIGHT)
        assert paused.center == pytest.approx(center)
        variances.append(paused.center_variance)
        # The last velocity leads to a place within two standard deviations.
        assert 2.0 * np.sqrt(paused.center_variance[0]) > min(pause, 10.0) * kalman.velocity[0]
    assert (np.diff(variances[:3], axis=0) > 0).all()
    assert variances[2] == pytest.approx(variances[3])


def test_a_measurement_lowers_the_variance_and_an_outlier_moves_little():
    kalman = filtered([(100, 200)] * 20).predict(INTERVAL, HEIGHT)
    corrected = kalman.correct(np.array([1000.0, 200.0]), STD)
    assert (corrected.center_variance < kalman.center_variance).all()
    assert abs(corrected.center[0] - 100.0) < 15.0
    assert corrected.center[1] == pytest.approx(200.0, abs=1.0)


@pytest.mark.parametrize("seconds", [0.0, 1e-3, 3600.0, 1e300])
def test_every_interval_is_valid(seconds):
    kalman = filtered([(100, 200)] * 3).predict(seconds, HEIGHT)
    kalman = kalman.correct(np.array([120.0, 200.0]), STD)
    for value in (kalman.center, kalman.velocity, kalman.center_variance, kalman.velocity_variance):
        assert np.isfinite(value).all()
    assert (kalman.center_variance > 0).all()
    assert (kalman.velocity_variance > 0).all()
    assert (
        kalman.center_velocity_covariance**2 <= kalman.center_variance * kalman.velocity_variance
    ).all()


def test_scaling_the_filter_is_scaling_its_measurements():
    factors = np.array([2.0, 2.0])
    measured = np.array([130.0, 190.0])
    small = filtered([(100, 200), (104, 199), (109, 197)])
    large = small.scale(factors).predict(INTERVAL, 2 * HEIGHT).correct(2 * measured, 2 * STD)
    small = small.predict(INTERVAL, HEIGHT).correct(measured, STD)
    for name, power in (
        ("center", 1),
        ("velocity", 1),
        ("center_variance", 2),
        ("velocity_variance", 2),
    ):
        np.testing.assert_allclose(getattr(large, name), getattr(small, name) * 2**power)


def test_camera_motion_maps_center_and_velocity():
    kalman = CenterKalmanFilter(
        np.array([30.0, 50.0]), np.array([4.0, 1.0]), *(np.array([2.0, 2.0]),) * 3
    ).compensate_camera_motion(np.array([[0.0, -1.0, 7.0], [1.0, 0.0, -9.0], [0.0, 0.0, 1.0]]))
    assert kalman.center == pytest.approx([-43.0, 21.0])
    assert kalman.velocity == pytest.approx([-1.0, 4.0])
