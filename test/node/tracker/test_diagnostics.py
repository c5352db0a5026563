"""The node's health on /diagnostics."""

import itertools
import signal
import time

import numpy as np
import pytest
from nodes import QUICK

from pf_tracker_ros.node import health_topic
from pf_tracker_ros.node.tracker.diagnostics import loss_warning


def health(client, condition):
    """The first report from now on that fulfills a condition."""
    client.health.clear()
    return client.report(condition)


def test_a_report_has_rate_age_times_state_and_confidence(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    began, now = time.monotonic(), client.get_clock().now().nanoseconds
    for index in range(4):
        client.show(images[index], now + index * 1_000_000)
    report = client.report(lambda report: report.values["frames"] == "4")
    assert report.name == "pf_tracker: tracker"
    assert (report.level, report.message) == ("OK", "tracking")
    values = report.values
    assert 0.5 < float(values["input_rate"]) <= 4.0 / health_topic.PERIOD
    elapsed = time.monotonic() - began
    assert 0.0 < float(values["seconds_since_image"]) <= elapsed
    assert -10.0 < float(values["image_age_ms"]) <= 1e3 * elapsed
    assert 0.0 < float(values["processing_time_ms"]) <= float(values["processing_time_max_ms"])
    assert values["state"] == "tracking"
    assert values["lifecycle"] == "active"
    assert values["image_topic"] == "/image"
    assert 0.0 <= float(values["confidence"]) <= 1.0
    assert 1.0 <= float(values["effective_sample_size"]) <= 20.0
    assert values["last_error"] == ""


def test_missing_images_are_a_warning(graph, client, images):
    graph.tracker(client, image_timeout=0.5, **QUICK)
    never = health(client, lambda h: h.level == "WARN")
    assert "no image for" in never.message
    assert "seconds_since_image" not in never.values
    client.show(images[0], client.at(0))
    silent = health(client, lambda h: h.level == "WARN")
    assert silent.message.endswith("waiting for a target")


def test_a_topic_without_images_is_logged_once_with_the_image_topics(graph, client, capfd):
    remapped = ["--ros-args", "-r", "image:=/camera"]
    graph.tracker(client, cli_args=remapped, image_timeout=0.5, **QUICK)
    silent = health(client, lambda h: "has no publisher" in h.message)
    assert silent.message.endswith(
        " s: /camera has no publisher, but images are on /image (-r image:=/image); "
        "waiting for a target"
    )
    health(client, lambda h: float(h.message.split()[3]) > float(silent.message.split()[3]) + 0.5)
    log = capfd.readouterr().err
    assert log.count("/camera has no publisher, but images are on /image (-r image:=/image)") == 1


def test_a_lost_target_is_an_error_and_an_occluded_one_a_warning(graph, client, images, box):
    hiding = {"track__wrong_box_cost": 1000.0, "track__lost_after": 0.06}
    graph.tracker(client, target_box=box, **QUICK, **hiding)
    expected = (("OK", "tracking"), ("WARN", "occluded"), ("ERROR", "lost"))
    for number, (level, state) in enumerate(expected):
        status = client.show(images[number], client.at(number))
        assert (status.level, status.values["state"]) == (level, state)
        report = health(client, lambda h, n=number: h.values["frames"] == str(n + 1))
        assert report.level == level
    # A lost target has no box.
    client.box_at(client.at(1))
    assert len(client.boxes) == 2


def test_an_error_is_a_warning_once_and_stays_the_last_error(graph, client, images):
    graph.tracker(client, image_timeout=60.0, **QUICK)
    client.show(images[0], client.at(0), "no_encoding")
    warned = client.report(lambda report: report.level == "WARN")
    assert "its encoding is 'no_encoding'" in warned.message
    calm = health(client, lambda h: h.level == "OK")
    assert calm.values["last_error"] == warned.message


def test_lost_frames_are_reported_with_the_remedy(graph, client, images):
    process = graph.process("-p", "preset:=li2007", "-p", "image_reliability:=reliable")
    client.meet()
    client.show(images[0], client.at(0))
    message = client.message(np.tile(images[0], (8, 8, 1)))
    index = seen = 0

    def lose():
        """Of so many, the publisher keeps the last ten for a tracker that does not read."""
        nonlocal index, seen
        # The longer it stands still, the more is lost by that: only what must be happens there.
        process.send_signal(signal.SIGSTOP)
        for number in range(index + 1, index + 40):
            seconds, nanoseconds = divmod(client.at(number), 10**9)
            message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
            client.images.publish(message)
        process.send_signal(signal.SIGCONT)
        index, seen = index + 40, len(client.health)

    def reported():
        found = [h for h in client.health if "lost on the way" in h.message]
        if not found and len(client.health) > seen + 5:
            # A busy machine spreads the loss over several reports.
            lose()
        return found

    lose()
    report = client.wait_for(reported, "diagnostics")[0]
    assert report.level == "WARN"
    assert "of the frames on /image are lost on the way despite reliable delivery" in report.message
    rate = float(report.values["frame_loss_rate"])
    # Ten of 39 arrive, and a report may come after the first of these.
    assert 0.4 < rate <= 29 / 30
    received, sent = (float(report.values[key]) for key in ("input_rate", "camera_rate"))
    assert received / sent == pytest.approx(1.0 - rate)
    status = client.show(images[0], client.at(index + 10))
    assert float(status.values["frame_loss_rate"]) > 0.2


def test_stamps_of_another_clock_have_no_age(graph, client, images):
    graph.tracker(client, **QUICK)
    client.show(images[0], 1_000_000_000)
    report = health(client, lambda h: h.values["frames"] == "1")
    assert report.values["image_age_ms"] == "unknown: the stamps are of another clock"


def test_an_overload_is_a_warning(graph, client, images, box):
    # So many that the processing takes nearly all time, on a busy machine too.
    graph.tracker(client, preset="zhang2015", particles=10_000, target_box=box)
    numbers = itertools.count()

    def overloaded():
        client.images.publish(client.message(images[0], client.at(next(numbers))))
        return [h for h in client.health if "overloaded, so frames are dropped" in h.message]

    report = client.wait_for(overloaded, "report of overload")[0]
    assert report.level == "WARN"
    assert "use a cheaper preset, fewer particles or smaller images" in report.message


def test_frames_lost_while_the_process_was_held_up_are_told_apart():
    # Of five seconds; a hold-up of two explains 40 % of lost frames, but not all of them.
    text = loss_warning(0.4, "/image", "reliable", held_up=2.0)
    assert "are lost, as the process was held up for 2.0 s; give it more processor time" in text
    assert "lost on the way with best-effort" in loss_warning(0.5, "/image", "best_effort")
    assert "are lost on the way despite" in loss_warning(1.0, "/image", "reliable", held_up=2.0)
