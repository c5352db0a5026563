"""Errors that quote what came over the wire are cut, wherever they are told."""

import pytest
import rclpy.logging

from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.node.tracker.reporter import Reporter


@pytest.mark.parametrize("kind", [RuntimeError, ValueError, lambda text: ImageError("data", text)])
def test_an_error_of_any_length_is_told_short(kind, capfd):
    reporter = Reporter(rclpy.logging.get_logger("reporter_test"))
    try:
        raise kind("x" * 10_000_000)
    except Exception as error:
        reporter.report_failure(error)
    assert 500 < len(reporter.last_error) <= 1000
    assert reporter.take_unshown() == [reporter.last_error]
    assert 500 < len(capfd.readouterr().err) < 6000


def test_an_unexpected_error_is_logged_with_where_it_came_from(capfd):
    reporter = Reporter(rclpy.logging.get_logger("reporter_test"))
    try:
        raise RuntimeError("no such thing")
    except RuntimeError as error:
        reporter.report_failure(error)
    assert reporter.last_error == "unexpected RuntimeError: no such thing"
    assert __file__ in capfd.readouterr().err
