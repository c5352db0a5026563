import numpy as np
import pytest

from pf_tracker_ros.targets.box_kalman_filter import GROWTH_VARIANCE, BoxKalmanFilter

INTERVAL = 0.1
HEIGHT = 100.0
STD = np.array([6.0, 10.0])


def filtered(centers):
    """The filter after measured centers, one per interval."""
    first = np.asarray(centers[0], float)
    kalman = BoxKalmanFilter.initiate(np.array([*(first - (20.0, 50.0)), 40.0, HEIGHT]))
    for center in centers[1:]:
        kalman = kalman.predict(INTERVAL, HEIGHT).correct_center(np.asarray(center, float), STD)
    return kalman


def grown(heights, interval, aspects=None, growth_variance=GROWTH_VARIANCE):
    """The filter after detections of these heights at rest, one per interval."""
    aspects = np.full(len(heights), 0.4) if aspects is None else aspects
    boxes = [
        np.array([100 - aspect * height / 2, 200 - height / 2, aspect * height, height])
        for height, aspect in zip(heights, aspects, strict=True)
    ]
    kalman = BoxKalmanFilter.initiate(boxes[0], growth_variance)
    for box in boxes[1:]:
        kalman = kalman.predict(interval, box[3], growth_variance).correct(box, interval)
    return kalman


def test_a_walking_target_is_predicted_farther_on():
    draw = np.random.default_rng(3)
    steps = np.arange(60)
    true = np.stack([100 + 5.0 * steps, 200 - 2.0 * steps], axis=1)
    kalman = filtered(true + draw.normal(size=true.shape) * (3.0, 4.0))
    for _ in range(10):
        kalman = kalman.predict(INTERVAL, HEIGHT)
    assert kalman.center == pytest.approx(true[-1] + 10 * np.array([5.0, -2.0]), abs=12.0)


def test_targets_move_across_the_image_more_than_up_and_down():
    last, later = (filtered([(100, 200)] * count) for count in (20, 21))
    std = np.sqrt(last.predict(1.0, HEIGHT).center_variance)
    assert std[0] > 1.5 * std[1] > 0.1 * HEIGHT
    assert later.center == pytest.approx(last.center)


def test_after_a_pause_the_center_stays_and_the_variance_grows_for_ten_seconds():
    kalman = filtered([(100 + 8.0 * step, 200) for step in range(30)])
    center, variances = kalman.center, []
    assert kalman.velocity[0] == pytest.approx(80.0, rel=0.1)
    moved = kalman.predict(2.0, HEIGHT)
    assert moved.center == pytest.approx(center + 2.0 * kalman.velocity[:2])
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
    corrected = kalman.correct_center(np.array([1000.0, 200.0]), STD)
    assert (corrected.center_variance < kalman.center_variance).all()
    assert abs(corrected.center[0] - 100.0) < 15.0
    assert corrected.center[1] == pytest.approx(200.0, abs=1.0)


def test_an_approaching_target_grows_between_its_detections():
    interval, rate = 1.2, 0.15
    draw = np.random.default_rng(5)
    true = 80 * np.exp(rate * interval * np.arange(8))
    noisy = true * np.exp(0.05 * draw.normal(size=8))
    kalman = grown(noisy, interval, growth_variance=rate**2)
    later = kalman.predict(interval, true[-1], rate**2)
    assert later.size[1] == pytest.approx(true[-1] * np.exp(rate * interval), rel=0.1)
    assert later.size[1] > 1.1 * kalman.size[1]
    assert later.size[0] == pytest.approx(0.4 * later.size[1], rel=0.01)


def test_the_rate_of_growth_keeps_its_variance_and_fades():
    kalman = grown(80 * 1.1 ** np.arange(8), 1.0, growth_variance=0.01)
    many = kalman
    for _ in range(200):
        many = many.predict(1.0, 100.0, 0.01)
    assert abs(many.velocity[2]) < 1e-6
    assert many.velocity_variance[2] == pytest.approx(0.01, rel=1e-6)


def test_two_steps_are_one_step_of_their_sum():
    kalman = grown(80 * 1.1 ** np.arange(8), 1.0)
    once = kalman.predict(1.1, 150.0)
    twice = kalman.predict(0.4, 150.0).predict(0.7, 150.0)
    for name in ("mean", "velocity", "variance", "covariance", "velocity_variance"):
        np.testing.assert_allclose(getattr(twice, name), getattr(once, name), rtol=1e-9)


def test_a_detection_moves_the_size_by_the_ratio_of_the_variances():
    kalman = grown([100.0] * 5, 0.5)
    gain = kalman.variance[2] / (kalman.variance[2] + 0.1**2)
    corrected = kalman.correct(np.array([80.0, 145.0, 40.0, 110.0]))
    assert 0.0 < gain < 1.0
    assert np.log(corrected.size[1] / kalman.size[1]) == pytest.approx(
        gain * np.log(110.0 / kalman.size[1])
    )


def test_detections_in_quick_succession_repeat_errors():
    kalman, box = grown([100.0] * 5, 0.5), np.array([80.0, 140.0, 40.0, 120.0])
    sizes = [kalman.correct(box, interval).size[1] for interval in (0.04, 0.4, 4.0)]
    assert kalman.size[1] < sizes[0] < sizes[1] < sizes[2] < 120.0


def test_a_fast_detector_averages_the_noise_of_the_height():
    heights = 100 * np.exp(0.1 * np.random.default_rng(7).normal(size=(40, 30)))
    ends = np.log([grown(row, 0.1).size[1] / 100 for row in heights])
    assert ends.std() < 0.06


def test_the_aspect_ratio_has_no_rate():
    kalman = grown([100.0] * 6, 0.5, aspects=0.3 * 1.1 ** np.arange(6))
    later = kalman.predict(1.0, 100.0)
    assert later.size == pytest.approx(kalman.size, rel=1e-3)


@pytest.mark.parametrize("seconds", [0.0, 1e-3, 3600.0, 1e300])
def test_every_interval_is_valid(seconds):
    kalman = filtered([(100, 200)] * 3).predict(seconds, HEIGHT)
    kalman = kalman.correct_center(np.array([120.0, 200.0]), STD)
    for value in (kalman.mean, kalman.velocity, kalman.variance, kalman.velocity_variance):
        assert np.isfinite(value).all()
    assert np.isfinite(kalman.size).all()
    assert (kalman.variance > 0).all()
    assert (kalman.velocity_variance >= 0).all()
    assert (kalman.covariance**2 <= kalman.variance * kalman.velocity_variance).all()


def test_scaling_the_filter_is_scaling_its_measurements():
    factors = np.array([2.0, 2.0])
    measured = np.array([130.0, 190.0])
    small = filtered([(100, 200), (104, 199), (109, 197)])
    large = small.scale(factors).predict(INTERVAL, 2 * HEIGHT).correct_center(2 * measured, 2 * STD)
    small = small.predict(INTERVAL, HEIGHT).correct_center(measured, STD)
    for name, power in (("velocity", 1), ("variance", 2), ("velocity_variance", 2)):
        expected = getattr(small, name).copy()
        expected[:2] *= 2**power
        np.testing.assert_allclose(getattr(large, name), expected)
    np.testing.assert_allclose(large.center, 2 * small.center)
    np.testing.assert_allclose(large.size, 2 * small.size)


def test_camera_motion_maps_center_and_velocity_and_keeps_the_size():
    kalman = filtered([(30, 50)])
    before = kalman._replace(
        mean=np.array([30.0, 50.0, 4.0, -1.0]), velocity=np.array([4.0, 1.0, 0.1, 0.0])
    )
    after = before.compensate_camera_motion(
        np.array([[0.0, -1.0, 7.0], [1.0, 0.0, -9.0], [0.0, 0.0, 1.0]])
    )
    assert after.center == pytest.approx([-43.0, 21.0])
    assert after.velocity == pytest.approx([-1.0, 4.0, 0.1, 0.0])
    assert after.size == pytest.approx(before.size)
