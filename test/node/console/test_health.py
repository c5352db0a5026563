"""How the tracker is, from what was heard of it."""

import pytest

from pf_tracker_ros.node.console.health import TrackerHealth

DIAGNOSTICS = {"level": "ok", "message": "tracking", "values": {"image_topic": "/image"}}


@pytest.fixture
def health():
    """Of a tracker that told of itself at the time 10."""
    health = TrackerHealth("/pf_tracker")
    health.take_diagnostics(DIAGNOSTICS, 10.0)
    return health


def test_silence_is_told_within_two_seconds(health):
    heard, silent = (health.summary(now, recording_paused=False) for now in (11.3, 11.8))
    assert (heard["tracker"], heard["text"]) == ("heard", "tracking")
    assert heard["image_topic"] == "/image"
    assert silent["tracker"] == "silent"


def test_a_tracker_that_was_never_heard_is_absent_not_silent():
    told = TrackerHealth("/left/pf_tracker").summary(0.0, recording_paused=False)
    assert (told["tracker"], told["level"]) == ("absent", "error")
    assert "/left/pf_tracker" in told["text"]


def test_trackers_of_other_names_are_named():
    health = TrackerHealth("/left/pf_tracker")
    told = health.summary(0.0, recording_paused=False, others=lambda: ["/pf_tracker"])
    assert told["text"] == (
        "no tracker is heard as /left/pf_tracker; there is /pf_tracker: start the console with -p "
        "tracker:=NAME"
    )


def test_what_keeps_the_console_from_hearing_is_told_as_long_as_it_lasts(health):
    health.take_fault("no match", 10.0)
    for now in (10.1, 11.5):
        told = health.summary(now, recording_paused=False, graph_faults=["no match"])
        assert (told["text"], told["level"]) == ("tracking; the console: no match", "error")


def test_a_fault_of_the_console_stands_beside_the_nodes_words_for_a_while(health):
    health.take_fault("no match", 10.0)
    health.take_status(DIAGNOSTICS, 20.0)
    assert health.summary(10.5, recording_paused=False)["text"] == "tracking; the console: no match"
    assert health.summary(20.5, recording_paused=False)["text"] == "tracking"


def test_a_fault_of_the_console_is_one_while_a_recording_stands_still(health):
    missing = {"level": "warn", "message": "no image for 5.0 s; waiting for a target", "values": {}}
    health.take_diagnostics(missing, 10.0)
    health.take_fault("no match", 10.0)
    told = health.summary(10.5, recording_paused=True)
    assert (told["text"], told["level"]) == ("waiting for a target; the console: no match", "error")


def test_images_are_not_missed_while_a_recording_stands_still(health):
    missing = {"level": "warn", "message": "no image for 5.0 s; waiting for a target", "values": {}}
    health.take_diagnostics(missing, 10.0)
    told = health.summary(10.5, recording_paused=True)
    assert (told["text"], told["level"]) == ("waiting for a target", "ok")
    assert health.summary(10.5, recording_paused=False)["level"] == "warn"


def test_what_the_diagnostics_say_of_another_state_gives_way_to_the_status(health):
    idle = {"image_topic": "/image", "state": "idle"}
    health.take_diagnostics({"level": "ok", "message": "waiting", "values": idle}, 0.5)
    lost = {"level": "error", "message": "lost", "values": {"state": "lost"}}
    health.take_status(lost, 0.6)
    told = health.summary(0.7, recording_paused=False)
    assert (told["text"], told["level"], told["image_topic"]) == ("lost", "error", "/image")
    skipped = {"level": "error", "message": "late", "values": {"state": "skipped"}}
    health.take_status(skipped, 0.7)
    assert health.summary(0.7, recording_paused=False)["text"] == "waiting"
    # What the diagnostics say of the same state may tell more.
    health.take_diagnostics(lost | {"message": "lost, and slow"}, 0.8)
    health.take_status(lost, 0.9)
    assert health.summary(0.9, recording_paused=False)["text"] == "lost, and slow"


def test_the_state_is_that_of_the_newest_word(health):
    health.take_diagnostics({"level": "ok", "message": "", "values": {"state": "idle"}}, 0.5)
    health.take_status({"level": "ok", "message": "", "values": {"state": "tracking"}}, 0.6)
    assert health.summary(0.7, recording_paused=True)["state"] == "tracking"
    health.take_diagnostics({"level": "ok", "message": "", "values": {"state": "idle"}}, 0.8)
    assert health.summary(0.9, recording_paused=True)["state"] == "idle"
