import numpy as np
import pytest

from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter

INTERVAL = 0.1
HEIGHT = 100.0
DEVIATION = np.array([6.0, 10.0])


def walked(places):
    """The course over measured places, the first one too."""
    first = np.asarray(places[0], float)
    course = CenterKalmanFilter.initiate(
        np.array([*(first - (20.0, 50.0)), 40.0, HEIGHT]), DEVIATION
    )
    for place in places[1:]:
        course = course.predict(INTERVAL, HEIGHT).correct(np.asarray(place, float), DEVIATION)
    return course


def test_who_walked_on_is_expected_farther_on():
    draw = np.random.default_rng(3)
    steps = np.arange(60)
    true = np.stack([100 + 5.0 * steps, 200 - 2.0 * steps], axis=1)
    course = walked(true + draw.normal(size=true.shape) * (3.0, 4.0))
    for _ in range(10):
        course = course.predict(INTERVAL, HEIGHT)
    assert course.center == pytest.approx(true[-1] + 10 * np.array([5.0, -2.0]), abs=12.0)


def test_it_is_less_sure_the_longer_nothing_is_measured():
    course = walked([(100, 200)] * 20)
    spreads = [course.center_variance]
    for _ in range(10):
        course = course.predict(INTERVAL, HEIGHT)
        spreads.append(course.center_variance)
    assert (np.diff(spreads, axis=0) > 0).all()
    assert (np.diff(spreads, 2, axis=0) > 0).all()


def test_after_a_pause_it_is_expected_where_it_was_and_for_ten_seconds_ever_less_surely():
    course = walked([(100 + 8.0 * step, 200) for step in range(30)])
    center, spreads = course.center, []
    assert course.velocity[0] == pytest.approx(80.0, rel=0.1)
    moved = course.predict(2.0, HEIGHT)
    assert moved.center == pytest.approx(center + 2.0 * course.velocity)
    for pause in (2.5, 5.0, 10.0, 1e9):
        paused = course.predict(pause, HEIGHT)
        assert paused.center == pytest.approx(center)
        spreads.append(paused.center_variance)
        # Wherever it went at its pace, it is within two deviations.
        assert 2.0 * np.sqrt(paused.center_variance[0]) > min(pause, 10.0) * course.velocity[0]
    assert (np.diff(spreads[:3], axis=0) > 0).all()
    assert spreads[2] == pytest.approx(spreads[3])


def test_what_is_measured_narrows_it_and_one_far_off_does_not_carry_it_away():
    course = walked([(100, 200)] * 20).predict(INTERVAL, HEIGHT)
    corrected = course.correct(np.array([1000.0, 200.0]), DEVIATION)
    assert (corrected.center_variance < course.center_variance).all()
    assert abs(corrected.center[0] - 100.0) < 15.0
    assert corrected.center[1] == pytest.approx(200.0, abs=1.0)


@pytest.mark.parametrize("seconds", [0.0, 1e-3, 3600.0, 1e300])
def test_any_time_may_have_passed(seconds):
    course = walked([(100, 200)] * 3).predict(seconds, HEIGHT)
    course = course.correct(np.array([120.0, 200.0]), DEVIATION)
    for value in (course.center, course.velocity, course.center_variance, course.velocity_variance):
        assert np.isfinite(value).all()
    assert (course.center_variance > 0).all()
    assert (course.velocity_variance > 0).all()
    assert (
        course.center_velocity_covariance**2 <= course.center_variance * course.velocity_variance
    ).all()


def test_an_image_of_another_size_changes_the_unit_alone():
    factors = np.array([2.0, 2.0])
    measured = np.array([130.0, 190.0])
    small = walked([(100, 200), (104, 199), (109, 197)])
    large = small.scale(factors).predict(INTERVAL, 2 * HEIGHT).correct(2 * measured, 2 * DEVIATION)
    small = small.predict(INTERVAL, HEIGHT).correct(measured, DEVIATION)
    for name, power in (
        ("center", 1),
        ("velocity", 1),
        ("center_variance", 2),
        ("velocity_variance", 2),
    ):
        np.testing.assert_allclose(getattr(large, name), getattr(small, name) * 2**power)


def test_a_camera_that_turns_by_a_right_angle_and_moves_takes_it_along():
    course = CenterKalmanFilter(
        np.array([30.0, 50.0]), np.array([4.0, 1.0]), *(np.array([2.0, 2.0]),) * 3
    ).compensate_camera_motion(np.array([[0.0, -1.0, 7.0], [1.0, 0.0, -9.0], [0.0, 0.0, 1.0]]))
    assert course.center == pytest.approx([-43.0, 21.0])
    assert course.velocity == pytest.approx([-1.0, 4.0])
