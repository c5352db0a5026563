"""Targets that a built-in detector starts."""

import re
import threading

import cv2
import pytest
from nodes import moving_block

from pf_tracker_ros import Detections
from pf_tracker_ros.node.tracker import session_manager
from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.targets.built_in_detectors import DETECTORS

MULTI_TARGET = {
    "preset": "li2007",
    "max_targets": 4,
    "image_reliability": "reliable",
    "built_in_detector_rate": 20.0,
}


def show_until(client, condition, first=0):
    """Show frames until a status fulfills a condition; returns it and the next frame's number."""
    number = first

    def met():
        nonlocal number
        status = client.show(moving_block(number), client.at(number))
        number += 1
        return status if condition(status) else None

    return client.wait_for(met, "such a status"), number


def test_a_moving_object_starts_a_target(graph, client):
    graph.tracker(client, built_in_detector="motion", **MULTI_TARGET)
    status, number = show_until(client, lambda status: status.targets)
    assert status.targets[0].values["label"] == "moving"
    for following in range(number, number + 5):
        status = client.show(moving_block(following), client.at(following))
        assert (status.level, len(status.targets)) == ("OK", 1)
        assert status.targets[0].values["id"] == "1"


def test_the_detector_changes_at_run_time(graph, client):
    graph.tracker(client, **MULTI_TARGET)
    key = "detector_runs"
    for number in range(3):
        assert client.show(moving_block(number), client.at(number)).values[key] == "0"
    assert client.set_parameters(built_in_detector="people").successful
    _, number = show_until(client, lambda status: int(status.values[key]) >= 2, first=3)
    assert client.set_parameters(built_in_detector="none").successful
    runs = client.show(moving_block(number), client.at(number)).values[key]
    for following in range(number + 1, number + 4):
        status = client.show(moving_block(following), client.at(following))
        assert status.values[key] == runs


def registered(**makers):
    """A registry of other detectors."""
    detectors = Registry("detector")
    for name, maker in makers.items():
        detectors.register(name)(maker)
    return detectors


@pytest.fixture
def without_people_detector(monkeypatch):
    """A machine on which the detector of people cannot be created."""

    def fail():
        raise cv2.error("no model")

    monkeypatch.setattr(session_manager, "DETECTORS", registered(**{**DETECTORS, "people": fail}))


@pytest.mark.usefixtures("without_people_detector")
def test_a_failing_detector_is_refused_and_changes_nothing(graph, client):
    graph.tracker(client, built_in_detector="motion", **MULTI_TARGET)
    _, number = show_until(client, lambda status: status.targets)
    refused = client.set_parameters(built_in_detector="people", particles=77)
    assert not refused.successful
    assert re.search("detector 'people' cannot be created: .*no model", refused.reason)
    status = client.show(moving_block(number), client.at(number))
    assert (status.values["state"], len(status.targets)) == ("tracking", 1)
    assert client.tunables()["particles"] != 77


@pytest.mark.usefixtures("without_people_detector")
def test_a_failing_detector_at_start_up_keeps_the_node_idle_until_corrected(graph, client):
    graph.tracker(client, built_in_detector="people", **MULTI_TARGET)
    status = client.show(moving_block(0), client.at(0))
    assert (status.level, status.values["frame"]) == ("ERROR", "waiting")
    assert "not tracking: the built-in detector 'people' cannot be created" in status.message
    assert client.set_parameters(built_in_detector="motion").successful
    status, _ = show_until(client, lambda status: status.targets, first=1)
    assert status.level == "OK"


def test_an_error_while_detecting_costs_no_frame(graph, client, monkeypatch):
    class Broken:
        def detect(self, image, interval):
            raise RuntimeError("no eyes")

    monkeypatch.setattr(session_manager, "DETECTORS", registered(motion=Broken))
    graph.tracker(client, built_in_detector="motion", **MULTI_TARGET)
    status, _ = show_until(client, lambda status: status.level == "WARN")
    assert status.message == "the detector 'motion' failed: RuntimeError: no eyes"
    assert status.values["frame"] == "waiting"


def test_detections_of_frames_before_a_time_jump_are_discarded(graph, client, monkeypatch):
    started, gates = [], [threading.Event(), threading.Event()]

    class Slow:
        def detect(self, image, interval):
            started.append(image)
            assert gates[len(started) - 1].wait(60.0)
            return Detections([[100.0, 10.0, 30.0, 30.0]])

    monkeypatch.setattr(session_manager, "DETECTORS", registered(motion=Slow))
    graph.tracker(client, built_in_detector="motion", **MULTI_TARGET)
    try:
        client.show(moving_block(0), client.at(50))
        client.show(moving_block(0), client.at(0))
        gates[0].set()
        # The second detection starts after the first result was taken.
        status, _ = show_until(client, lambda status: len(started) == 2, first=1)
        assert (status.level, status.values["detector_runs"]) == ("OK", "0")
    finally:
        gates[1].set()


def test_a_start_over_that_was_asked_for_is_no_warning(graph, client, monkeypatch, capfd):
    class Still:
        def detect(self, image, interval):
            return Detections([[100.0, 10.0, 30.0, 30.0]])

    monkeypatch.setattr(session_manager, "DETECTORS", registered(motion=Still))
    graph.tracker(client, built_in_detector="motion", time_jump="restart", **MULTI_TARGET)
    show_until(client, lambda status: status.values["targets"] != "0", first=50)
    client.show(moving_block(0), client.at(0))
    (line,) = [one for one in capfd.readouterr().err.splitlines() if "time went back" in one]
    assert "INFO" in line


@pytest.mark.skipif(DETECTIONS_CLASS is not None, reason="vision_msgs is installed")
def test_without_vision_msgs_the_log_names_the_alternatives(graph, capfd):
    graph.tracker(max_targets=3)
    (warning,) = [one for one in capfd.readouterr().err.splitlines() if "needs vision_msgs" in one]
    assert "draw targets or set 'built_in_detector'" in warning
