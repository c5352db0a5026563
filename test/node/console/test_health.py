"""The health of the tracker, from its messages."""

import pytest

from pf_tracker_ros.node.console.health import TrackerHealth

DIAGNOSTICS = {"level": "ok", "message": "tracking", "values": {"image_topic": "/image"}}


@pytest.fixture
def health():
    """Of a tracker with diagnostics at the time 10."""
    health = TrackerHealth("/pf_tracker")
    health.take_diagnostics(DIAGNOSTICS, 10.0)
    return health


def test_silence_is_reported_within_two_seconds(health):
    alive, silent = (health.summary(now, recording_paused=False) for now in (11.3, 11.8))
    assert (alive["tracker"], alive["text"]) == ("alive", "tracking")
    assert alive["image_topic"] == "/image"
    assert silent["tracker"] == "silent"


def test_a_tracker_without_any_message_is_absent_not_silent():
    summary = TrackerHealth("/left/pf_tracker").summary(0.0, recording_paused=False)
    assert (summary["tracker"], summary["level"]) == ("absent", "error")
    assert "/left/pf_tracker" in summary["text"]


def test_available_trackers_are_suggested():
    health = TrackerHealth("/left/pf_tracker")
    summary = health.summary(0.0, recording_paused=False, others=lambda: ["/pf_tracker"])
    assert summary["text"] == (
        "no tracker /left/pf_tracker; there is /pf_tracker: start the console with -p tracker:=NAME"
    )


def test_a_fault_of_the_graph_is_reported_as_long_as_it_lasts(health):
    health.take_fault("no match", 10.0)
    for now in (10.1, 11.5):
        summary = health.summary(now, recording_paused=False, graph_faults=["no match"])
        assert (summary["text"], summary["level"]) == ("tracking; the console: no match", "error")


def test_a_fault_of_the_console_is_reported_for_some_seconds(health):
    health.take_fault("no match", 10.0)
    health.take_status(DIAGNOSTICS, 20.0)
    assert health.summary(10.5, recording_paused=False)["text"] == "tracking; the console: no match"
    assert health.summary(20.5, recording_paused=False)["text"] == "tracking"


def test_missing_images_are_no_fault_while_a_recording_is_paused(health):
    missing = {"level": "warn", "message": "no image for 5.0 s; waiting for a target", "values": {}}
    health.take_diagnostics(missing, 10.0)
    summary = health.summary(10.5, recording_paused=True)
    assert (summary["text"], summary["level"]) == ("waiting for a target", "ok")
    assert health.summary(10.5, recording_paused=False)["level"] == "warn"
    # A fault of the console is one all the same.
    health.take_fault("no match", 10.0)
    summary = health.summary(10.5, recording_paused=True)
    text = "waiting for a target; the console: no match"
    assert (summary["text"], summary["level"]) == (text, "error")


@pytest.mark.parametrize(
    ("message", "level", "shown"),
    [
        ("lost", "error", "error"),
        ("tracking", "warn", "ok"),
        ("tracking; processing is too slow", "warn", "warn"),
    ],
)
def test_a_message_keeps_its_level_while_a_recording_is_paused(health, message, level, shown):
    state = message.partition(";")[0]
    own = {"tracking": "ok", "lost": "error"}[state]
    health.take_status({"level": own, "message": state, "values": {"state": state}}, 10.0)
    missing = f"no image for 5.0 s; {message}"
    health.take_diagnostics({"level": level, "message": missing, "values": {"state": state}}, 10.0)
    summary = health.summary(10.5, recording_paused=True)
    assert (summary["text"], summary["level"]) == (message, shown)


def test_a_newer_status_with_another_state_replaces_the_diagnostics(health):
    idle = {"image_topic": "/image", "state": "idle"}
    health.take_diagnostics({"level": "ok", "message": "waiting", "values": idle}, 0.5)
    lost = {"level": "error", "message": "lost", "values": {"state": "lost"}}
    health.take_status(lost, 0.6)
    summary = health.summary(0.7, recording_paused=False)
    assert (summary["text"], summary["level"], summary["image_topic"]) == (
        "lost",
        "error",
        "/image",
    )
    skipped = {"level": "error", "message": "late", "values": {"state": "skipped"}}
    health.take_status(skipped, 0.7)
    assert health.summary(0.7, recording_paused=False)["text"] == "waiting"
    # In the same state the diagnostics have more to say.
    health.take_diagnostics(lost | {"message": "lost, and slow"}, 0.8)
    health.take_status(lost, 0.9)
    assert health.summary(0.9, recording_paused=False)["text"] == "lost, and slow"


def test_the_state_is_that_of_the_newest_message(health):
    health.take_diagnostics({"level": "ok", "message": "", "values": {"state": "idle"}}, 0.5)
    health.take_status({"level": "ok", "message": "", "values": {"state": "tracking"}}, 0.6)
    assert health.summary(0.7, recording_paused=True)["state"] == "tracking"
    health.take_diagnostics({"level": "ok", "message": "", "values": {"state": "idle"}}, 0.8)
    assert health.summary(0.9, recording_paused=True)["state"] == "idle"
