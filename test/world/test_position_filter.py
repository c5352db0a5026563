"""The filter over time against a batch estimate, and its covariance against simulated errors."""

import numpy as np
import pytest

from pf_tracker_ros.world import PositionFilter

SECOND = 1_000_000_000


def test_without_acceleration_it_is_the_fitted_line():
    """The Kalman filter's result is the weighted least squares fit of a line, with its prior."""
    generator = np.random.default_rng(0)
    stamps = [0, SECOND // 10, SECOND // 4, SECOND]
    covariances = [np.diag(generator.uniform(0.01, 0.1, 2)) for _ in stamps]
    places = [generator.normal(time * 1e-9, 0.1, 2) for time in stamps]
    tracker = PositionFilter(0.0, (0.0,), gate=1e9)
    for stamp, place, covariance in zip(stamps, places, covariances, strict=True):
        assert tracker.update(stamp, place, covariance)
    result = tracker.predict(2 * SECOND)
    for axis in (0, 1):
        # Rows: measurements, and a velocity of 0 with a standard deviation of 1.2 m/s.
        design = np.array([[1.0, stamp * 1e-9] for stamp in stamps] + [[0.0, 1.0]])
        weights = [1.0 / covariance[axis, axis] for covariance in covariances] + [1.0 / 1.2**2]
        normal = design.T @ np.diag(weights) @ design
        values = [place[axis] for place in places] + [0.0]
        start, velocity = np.linalg.solve(normal, design.T @ np.diag(weights) @ values)
        assert result.velocity[axis] == pytest.approx(velocity)
        assert result.position[axis] == pytest.approx(start + 2.0 * velocity)
        expected = np.array([1.0, 2.0]) @ np.linalg.inv(normal) @ [1.0, 2.0]
        assert result.covariance[axis, axis] == pytest.approx(expected)


def walk(generator, steps, interval, density):
    """(steps, 4) states of a white-noise acceleration, by its exact covariance over a step."""
    one_axis = density * np.array([[interval**3 / 3, interval**2 / 2], [interval**2 / 2, interval]])
    states = [np.concatenate([np.zeros(2), generator.normal(0.0, 1.0, 2)])]
    for _ in range(steps - 1):
        noise = generator.multivariate_normal(np.zeros(2), one_axis, 2)
        moved = states[-1].copy()
        moved[:2] += interval * moved[2:] + noise[:, 0]
        moved[2:] += noise[:, 1]
        states.append(moved)
    return np.array(states)


@pytest.mark.parametrize("rate", [7.0, 25.0])
@pytest.mark.parametrize("times", [(0.0,), (0.1, 2.0), (0.0, 1.0)])
def test_the_covariance_is_that_of_the_errors(rate, times):
    generator = np.random.default_rng(1)
    interval = 1.0 / rate
    root = np.array([[0.5, 0.1], [0.1, 0.2]])
    correlations = np.array([np.exp(-interval / one) if one else 0.0 for one in times])[:, None]
    both, of_velocity = [], []
    for _ in range(20):
        states = walk(generator, 50, interval, 0.15)
        tracker = PositionFilter(0.15, times)
        parts = generator.normal(size=(len(times), 2))
        for index, state in enumerate(states):
            stamp = round(index * interval * 1e9)
            error = root @ parts.sum(axis=0) / np.sqrt(len(times))
            tracker.update(stamp, state[:2] + error, root @ root)
            fresh = generator.normal(size=parts.shape)
            parts = correlations * parts + np.sqrt(1.0 - correlations**2) * fresh
            if index > 25:
                result = tracker.predict(stamp)
                difference = np.concatenate([result.position, result.velocity]) - state
                both.append(difference @ np.linalg.solve(result.covariance, difference))
                of_velocity.append(
                    difference[2:] @ np.linalg.solve(result.covariance[2:, 2:], difference[2:])
                )
    assert 0.75 < np.mean(both) / 4.0 < 1.3
    assert 0.75 < np.mean(of_velocity) / 2.0 < 1.3


def test_a_measurement_outside_the_gate_is_rejected_until_it_stays():
    tracker = PositionFilter(reset_after=1.0)
    for index in range(20):
        assert tracker.update(index * SECOND // 10, (0.0, 0.0), 0.01 * np.eye(2))
    assert not tracker.update(2 * SECOND, (5.0, 0.0), 0.01 * np.eye(2))
    assert tracker.normalized_innovation > 13.8
    assert tracker.rejected_since == 2 * SECOND
    assert np.abs(tracker.predict(2 * SECOND).position).max() < 0.1
    # One of the old place ends the rejections.
    assert tracker.update(21 * SECOND // 10, (0.0, 0.0), 0.01 * np.eye(2))
    assert tracker.rejected_since is None
    later = 32 * SECOND // 10
    assert not tracker.update(later - SECOND, (9.0, 0.0), 0.01 * np.eye(2))
    assert not tracker.update(later - SECOND // 10, (9.0, 0.0), 0.01 * np.eye(2))
    assert not tracker.has_restarted
    assert tracker.update(later, (9.0, 0.0), 0.01 * np.eye(2))
    assert tracker.has_restarted
    assert tracker.predict(later).position == pytest.approx((9.0, 0.0))
    # Rejections before and after an interruption are not of one run.
    assert not tracker.update(later + SECOND // 10, (20.0, 0.0), 0.01 * np.eye(2))
    tracker.interrupt()
    assert not tracker.update(later + 2 * SECOND, (20.0, 0.0), 0.01 * np.eye(2))
    assert tracker.rejected_since == later + 2 * SECOND


def test_the_density_of_a_measurement_given_its_prediction():
    """At first, that of two normal errors and an unknown speed after a moment."""
    tracker = PositionFilter(acceleration_density=0.0, correlation_times=(0.0,))
    tracker.update(0, (0.0, 0.0), np.eye(2))
    assert tracker.log_density is None
    tracker.update(1000, (1.0, 2.0), np.eye(2))
    # The variance is 1 + 1 along each axis.
    expected = -(1.0 + 4.0) / 4.0 - np.log(2.0 * np.pi * 2.0)
    assert tracker.log_density == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("sd", [0.1, 0.5, 1.0])
def test_it_keeps_up_with_who_walks_off(sd):
    """However uncertain the place, where errors last: its changes are seen.

    With the errors as estimated states it is 0.1 to 0.3 m behind in all these moments but the last.
    """
    tracker = PositionFilter(correlation_times=(0.3, 5.0))
    for step in range(100):
        time, place = 0.05 * step, max(0.05 * step - 2.0, 0.0)
        tracker.update(round(time * SECOND), (place, 0.0), sd**2 * np.eye(2))
        if step in (50, 60, 80):
            assert tracker.predict(round(time * SECOND)).position[0] > place - 0.1


def followed(positions, places, seed):
    """Results in each frame of 0.05 s, with errors of 6 cm that mostly last, as those of depth."""
    generator = np.random.default_rng(seed)
    kept = np.exp(-0.05 / np.array([[0.3], [5.0]]))
    parts, results = generator.normal(size=(2, 2)), []
    for step, place in enumerate(places):
        stamp = round(0.05 * step * SECOND)
        error = parts.T @ [0.02, 0.055]
        positions.update(stamp, (place, 0.0) + error, 0.06**2 * np.eye(2))
        results.append(positions.predict(stamp))
        parts = kept * parts + np.sqrt(1.0 - kept**2) * generator.normal(size=parts.shape)
    return results


def test_who_stands_has_no_speed_though_errors_drift():
    speeds = {0.0: [], 6.0: []}
    for seed in range(5):
        for stands_for, found in speeds.items():
            positions = PositionFilter(correlation_times=(0.3, 5.0), stands_for=stands_for)
            results = followed(positions, np.zeros(150), seed)
            found += [np.hypot(*one.velocity) for one in results[40:]]
    assert np.quantile(speeds[6.0], 0.95) < 0.08
    assert np.quantile(speeds[0.0], 0.95) > 0.15


def test_who_starts_and_stops_is_followed_and_the_covariance_is_that_of_the_errors():
    """Stands for 3 s, walks at 1 m/s for 3 s, and stands again."""
    places = np.clip(0.05 * np.arange(180) - 3.0, 0.0, 3.0)
    distances, speeds = [], []
    for seed in range(10):
        positions = PositionFilter(correlation_times=(0.3, 5.0), stands_for=6.0)
        results = followed(positions, places, seed)
        errors = [one.position - (place, 0.0) for one, place in zip(results, places, strict=True)]
        assert np.hypot(*np.array(errors).T).max() < 0.4
        assert positions.rejected_since is None
        distances += [
            error @ np.linalg.solve(one.covariance[:2, :2], error) / 2.0
            for error, one in zip(errors[20:], results[20:], strict=True)
        ]
        speeds.append([one.velocity[0] for one in results])
    assert 0.6 < np.mean(distances) < 1.6
    by_time = np.mean(speeds, axis=0)
    # A second after the start, and a second after the stop.
    assert by_time[80] == pytest.approx(1.0, abs=0.1)
    assert by_time[140] == pytest.approx(0.0, abs=0.1)


def test_who_walks_out_of_sight_is_expected_to_walk_on():
    positions = PositionFilter(correlation_times=(0.3, 5.0), stands_for=6.0)
    followed(positions, 0.05 * np.arange(100), 0)
    assert positions.predict(7 * SECOND).position[0] == pytest.approx(7.0, abs=0.5)


def test_late_measurements_and_early_predictions():
    tracker = PositionFilter()
    assert tracker.predict(0) is None
    assert tracker.update(SECOND, (1.0, 2.0, 3.0), np.eye(3))
    assert not tracker.update(SECOND, (1.0, 2.0), np.eye(2))
    assert not tracker.update(SECOND // 2, (1.0, 2.0), np.eye(2))
    assert tracker.predict(0).stamp == SECOND
    assert tracker.predict(0).position == pytest.approx((1.0, 2.0))
    tracker.reset()
    assert tracker.predict(SECOND) is None
    assert tracker.update(0, (1.0, 2.0), np.eye(2))


@pytest.mark.parametrize(
    ("position", "covariance", "message"),
    [
        ((1.0,), np.eye(1), "shape"),
        ((1.0, 2.0), np.eye(3), "shape"),
        ((np.nan, 2.0), np.eye(2), "finite"),
        ((1.0, 2.0), np.full((2, 2), np.inf), "finite"),
        ((1.0, 2.0), np.zeros((2, 2)), "positive definite"),
        ((1.0, 2.0), [[1.0, 5.0], [-5.0, 1.0]], "symmetric"),
        ((1e200, 2.0), np.eye(2), "allowed: up to 1e\\+12 m"),
        ((1.0, 2.0), 1e200 * np.eye(2), "allowed: up to 1e\\+12 m and its square"),
    ],
)
def test_a_wrong_measurement_leaves_the_filter_as_it_was(position, covariance, message):
    tracker = PositionFilter()
    tracker.update(0, (1.0, 2.0), np.eye(2))
    with pytest.raises(ValueError, match=message):
        tracker.update(SECOND, position, covariance)
    assert tracker.predict(0).position == pytest.approx((1.0, 2.0))


def test_the_uncertainty_grows_without_measurements_and_the_largest_numbers_stay_finite():
    tracker = PositionFilter()
    for index in range(10):
        tracker.update(index * SECOND // 10, (0.1 * index, 0.0), 0.01 * np.eye(2))
    sds = [tracker.predict((10 + 10 * index) * SECOND // 10).covariance[0, 0] for index in range(4)]
    assert sds == sorted(sds)
    assert tracker.predict(3 * SECOND).position[0] > 2.0
    tracker = PositionFilter(acceleration_density=1e12, stands_for=1e12)
    with np.errstate(all="raise"):
        for step in range(3):
            tracker.update(step * SECOND, (1e12, -1e12), 1e24 * np.eye(2))
        assert np.isfinite(tracker.predict(10 * SECOND).covariance).all()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("correlation_times", [(), (0.1, -1.0), (np.nan,), (np.inf,), (1e200,), 0.1]),
        ("acceleration_density", [-1.0, np.nan, np.inf, 1e200]),
        ("gate", [-1.0, np.nan, np.inf, 1e200]),
        ("reset_after", [-1.0, np.nan, np.inf, 1e200]),
        ("stands_for", [-1.0, np.nan, np.inf, 1e200]),
    ],
)
def test_wrong_parameters_are_rejected(name, values):
    for value in values:
        with pytest.raises(ValueError, match=name):
            PositionFilter(**{name: value})
