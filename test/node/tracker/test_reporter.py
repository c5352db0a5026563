"""Errors are cut to a limited length, and repetitions are dropped."""

import pytest
import rclpy.logging

from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.node.tracker import reporter as reporter_module
from pf_tracker_ros.node.tracker.reporter import LOG_INTERVAL, Reporter, Throttle


@pytest.mark.parametrize("kind", [RuntimeError, ValueError, lambda text: ImageError("data", text)])
def test_a_long_error_is_cut(kind, capfd):
    reporter = Reporter(rclpy.logging.get_logger("reporter_test"))
    try:
        raise kind("x" * 10_000_000)
    except Exception as error:
        reporter.report_failure(error)
    assert 500 < len(reporter.last_error) <= 1000
    assert reporter.take_unshown() == [reporter.last_error]
    assert 500 < len(capfd.readouterr().err) < 6000


def test_an_unexpected_error_is_logged_with_its_traceback(capfd):
    reporter = Reporter(rclpy.logging.get_logger("reporter_test"))
    try:
        raise RuntimeError("no such thing")
    except RuntimeError as error:
        reporter.report_failure(error)
    assert reporter.last_error == "unexpected RuntimeError: no such thing"
    assert __file__ in capfd.readouterr().err


def test_sentences_that_differ_in_numbers_are_repetitions(monkeypatch):
    now = 100.0
    monkeypatch.setattr(reporter_module.time, "monotonic", lambda: now)
    throttle = Throttle()
    assert throttle.unrepeated(["2 of 9 are old", "gone"]) == ("2 of 9 are old", "gone")
    assert throttle.unrepeated(["3.5 of -7 are old", "new"]) == ("new",)
    now += LOG_INTERVAL
    assert throttle.unrepeated(["4 of 9 are old"]) == ("4 of 9 are old",)
