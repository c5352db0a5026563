"""The log of state changes: at most one line a second, the last state always."""

from types import SimpleNamespace

import pytest

from pf_tracker_ros.node.tracker import status
from pf_tracker_ros.node.tracker.status import StateLog


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


def test_each_change_is_logged(log):
    log.update(2.0, "tracking", "occluded", "occluded", "lost", "tracking")
    assert log.lines == [
        "tracking -> occluded, confidence 0.50",
        "occluded -> lost, confidence 0.50",
        "lost -> tracking, confidence 0.50",
    ]


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
