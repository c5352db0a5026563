"""The status of a skipped frame: state, cause and duration, without an estimate."""

import itertools
import math

import pytest
from nodes import QUICK
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros.node.tracker import status as status_module

ESTIMATE_KEYS = ("confidence", "covariance_xx", "effective_sample_size", "particles")


@pytest.fixture
def tracking(graph, client, images, box):
    """A node that tracks, after two frames."""
    node = graph.tracker(client, target_box=box, **QUICK)
    assert client.show_all(images[:2])[-1].values["state"] == "tracking"
    return node


def skipping(client, images, cause):
    """A function that sends one more frame that is skipped and returns its status."""
    numbers = itertools.count(2)

    def show():
        number = next(numbers)
        if cause == "refused":
            return client.show(images[number % 20][:50], client.at(number))
        if cause == "duplicate":
            return client.show(images[number % 20], client.at(1))
        return client.show(images[number % 20], client.at(number))

    if cause == "paused":
        client.ask(SetBool, "enable", data=False)
    return show


CAUSES = {
    "refused": "start a target on these images (~/target, ~/click), stop the present one",
    "duplicate": "on /image; the publisher must stamp each image with its own time of capture",
    "paused": "paused; resume with the service ~/enable",
}


@pytest.mark.parametrize("cause", CAUSES)
def test_a_skipped_frame_has_its_cause_and_duration(  # noqa: PLR0917
    tracking, client, images, cause, capfd, monkeypatch
):
    show = skipping(client, images, cause)
    monkeypatch.setattr(status_module, "REPORT_AFTER", math.inf)
    first = show()
    assert first.level == ("ERROR" if cause == "refused" else "OK")
    assert (first.values["frame"], first.values["state"]) == (cause, "skipped")
    assert (first.values["skipped_frames"], first.values["last_state"]) == ("1", "tracking")
    assert CAUSES[cause] in first.message
    monkeypatch.setattr(status_module, "REPORT_AFTER", 0.0)
    second = show()
    assert second.level == ("ERROR" if cause == "refused" else "WARN")
    assert (second.values["state"], second.values["skipped_frames"]) == ("skipped", "2")
    assert float(second.values["skipped_seconds"]) > float(first.values["skipped_seconds"])
    assert not [name for name in ESTIMATE_KEYS if name in second.values]
    assert CAUSES[cause] in second.message
    seconds, nanoseconds = divmod(client.at(1), 10**9)
    assert second.values["last_stamp"] == f"{seconds}.{nanoseconds:09d}"
    client.health.clear()

    def warned():
        show()
        return [h for h in client.health if "no frame processed for" in h.message]

    health = client.wait_for(warned, "a warning in /diagnostics")[0]
    assert (health.level, health.values["state"]) == ("WARN", "skipped")
    assert CAUSES[cause] in health.message
    if cause == "paused":
        client.ask(SetBool, "enable", data=True)
    again = client.show(images[3], client.at(3))
    assert (again.level, again.values["state"]) == ("OK", "tracking")
    assert "skipped_frames" not in again.values
    client.box_at(client.at(3))
    assert len(client.boxes) == 3
    log = capfd.readouterr().err
    assert log.count("frames are processed again, after") == (cause != "paused")
    assert log.count(CAUSES[cause]) == (cause != "paused")


def test_a_late_frame_is_skipped(tracking, client, images):
    late = client.show(images[0], client.at(0.5))
    assert (late.level, late.values["frame"], late.values["state"]) == ("OK", "late", "skipped")
    assert "on /image is older than the last one; let a single camera" in late.message


def test_a_target_stopped_during_a_pause_is_not_the_last_state(tracking, client, images):
    client.ask(SetBool, "enable", data=False)
    assert client.show(images[2], client.at(2)).values["last_state"] == "tracking"
    client.ask(Trigger, "stop")
    status = client.show(images[2], client.at(3))
    assert (status.values["state"], status.values["last_state"]) == ("skipped", "idle")


FROZEN = "frozen: the images on /image have not changed for more than 0.5 s; restart the camera"


def test_frozen_images_are_skipped_until_one_differs(graph, client, images, box, capfd):
    graph.tracker(client, target_box=box, frozen_after=0.5, **QUICK)
    client.show_all(images[:3])
    statuses = [client.show(images[2], client.at(number)) for number in range(3, 20)]
    assert [s.values["frame"] for s in statuses] == ["tracked"] * 12 + ["frozen"] * 5
    for count, status in enumerate(statuses[12:], 1):
        assert (status.level, status.values["state"]) == ("WARN", "skipped")
        assert status.values["skipped_frames"] == str(count)
        assert status.values["last_state"] == "tracking"
        assert FROZEN in status.message
        assert status.targets == ()
    health = client.report(lambda report: report.values["dropped_frozen"] == "5")
    assert (health.level, health.values["dropped_duplicate"]) == ("WARN", "0")
    assert FROZEN in health.message
    log = capfd.readouterr().err
    assert log.count("have not changed") == log.count(FROZEN) == 1
    assert "frames are processed again" not in log
    again = client.show(images[3], client.at(20))
    assert (again.level, again.values["frame"]) == ("OK", "tracked")
    log = capfd.readouterr().err
    assert log.count("frames are processed again, after 5 skipped") == 1
