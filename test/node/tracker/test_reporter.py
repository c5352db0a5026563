"""Errors are cut to a limited length, repetitions are dropped, states are logged once a second."""

from types import SimpleNamespace

import pytest
import rclpy.logging

from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.node.tracker import reporter as reporter_module
from pf_tracker_ros.node.tracker import status
from pf_tracker_ros.node.tracker.outcome_log import StateLog
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


def test_an_error_is_shown_once_in_a_status():
    reporter = Reporter(rclpy.logging.get_logger("reporter_test"))
    for error in ("one", "other", "one"):
        reporter.report(error)
    assert (reporter.take_unshown(), reporter.take_unshown()) == (["one", "other"], [])


def test_sentences_that_differ_in_numbers_are_repetitions(monkeypatch):
    now = 100.0
    monkeypatch.setattr(reporter_module.time, "monotonic", lambda: now)
    throttle = Throttle()
    assert throttle.unrepeated(["2 of 9 are old", "gone"]) == ("2 of 9 are old", "gone")
    assert throttle.unrepeated(["3.5 of -7 are old", "new"]) == ("new",)
    now += LOG_INTERVAL
    assert throttle.unrepeated(["4 of 9 are old"]) == ("4 of 9 are old",)


@pytest.fixture
def log(monkeypatch):
    """A log of states with a clock that the test sets, and the lines that it wrote."""
    lines, clock = [], SimpleNamespace(now=100.0)
    monkeypatch.setattr(status.time, "monotonic", lambda: clock.now)
    states = StateLog(SimpleNamespace(info=lines.append))

    def update(seconds, *names, id=1):
        for name in names:
            clock.now += seconds
            states.update(id, SimpleNamespace(state=name, confidence=0.5))

    return SimpleNamespace(update=update, lines=lines)


def test_a_flicker_is_logged_once_a_second_and_the_last_state_always(log):
    log.update(0.04, *["occluded", "tracking"] * 50, "tracking")
    assert 3 <= len(log.lines) <= 5
    log.update(0.04, *["tracking"] * 30)
    assert log.lines[-1].startswith("occluded -> tracking")
    count = len(log.lines)
    log.update(0.04, *["tracking"] * 100)
    assert len(log.lines) == count


def test_another_target_starts_as_tracked(log):
    log.update(2.0, "occluded")
    log.update(2.0, "tracking", "occluded", id=2)
    assert log.lines == ["tracking -> occluded, confidence 0.50"] * 2
