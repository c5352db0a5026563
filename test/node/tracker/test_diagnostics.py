"""The node's health on /diagnostics."""

import itertools
import time

import pytest

QUICK = {"preset": "li2007", "particles": 20, "image_reliability": "reliable"}


def health(client, condition):
    """The first report from now on that a condition holds of."""
    client.health.clear()
    return client.wait_for(lambda: [h for h in client.health if condition(h)], "diagnostics")[0]


def test_health_tells_rate_age_times_state_and_confidence(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    now = client.get_clock().now().nanoseconds
    for index in range(4):
        client.show(images[index], now + index * 1_000_000)
    report = health(client, lambda h: h.values["frames"] == "4")
    assert report.name == "pf_tracker: tracker"
    assert (report.level, report.message) == ("OK", "tracking")
    values = report.values
    assert 0.5 < float(values["input_rate"]) <= 4.0
    assert 0.0 < float(values["seconds_since_image"]) < 3.0
    assert -10.0 < float(values["image_age_ms"]) < 5000.0
    assert 0.0 < float(values["processing_time_ms"]) <= float(values["processing_time_max_ms"])
    assert values["state"] == "tracking"
    assert values["lifecycle"] == "active"
    assert values["image_topic"] == "/image"
    assert 0.0 <= float(values["confidence"]) <= 1.0
    assert 1.0 <= float(values["effective_sample_size"]) <= 20.0
    assert values["last_error"] == ""


def test_reports_come_once_a_second(graph, client):
    graph.tracker(client, **QUICK)
    client.wait_for(lambda: len(client.health) >= 3, "three reports")
    stamps = [report.stamp for report in client.health]
    assert [round((b - a) / 1e9) for a, b in itertools.pairwise(stamps)] == [1, 1]


def test_a_camera_that_falls_silent_is_a_warning(graph, client, images):
    graph.tracker(client, image_timeout=0.5, **QUICK)
    never = health(client, lambda h: h.level == "WARN")
    assert "no image for" in never.message
    assert "seconds_since_image" not in never.values
    client.show(images[0], client.at(0))
    silent = health(client, lambda h: h.level == "WARN")
    assert silent.message.endswith("waiting for a target")


def test_a_wrong_topic_is_told_once_in_the_log_with_where_the_images_are(graph, client, capfd):
    remapped = ["--ros-args", "-r", "image:=/camera"]
    graph.tracker(client, cli_args=remapped, image_timeout=0.5, **QUICK)
    silent = health(client, lambda h: "nobody publishes" in h.message)
    assert silent.message.endswith(
        " s: nobody publishes /camera, but /image (-r image:=/image); waiting for a target"
    )
    health(client, lambda h: float(h.message.split()[3]) > float(silent.message.split()[3]) + 1.5)
    log = capfd.readouterr().err
    assert log.count("nobody publishes /camera, but /image (-r image:=/image)") == 1


def test_a_lost_target_is_an_error_and_a_hidden_one_a_warning(graph, client, images, box):
    hiding = {"track__occluded_below": 1.0, "track__lost_after": 0.06}
    graph.tracker(client, target_box=box, **QUICK, **hiding)
    client.show_all(images[:2])
    assert health(client, lambda h: h.values["frames"] == "2").level == "WARN"
    client.show(images[2], client.at(2))
    assert health(client, lambda h: h.values["frames"] == "3").level == "ERROR"


def test_what_goes_wrong_is_a_warning_once_and_stays_the_last_error(graph, client, images):
    graph.tracker(client, image_timeout=60.0, **QUICK)
    client.show(images[0], client.at(0), "no_encoding")
    warned = client.wait_for(lambda: [h for h in client.health if h.level == "WARN"], "warning")[0]
    assert "its encoding is 'no_encoding'" in warned.message
    calm = health(client, lambda h: h.level == "OK")
    assert calm.values["last_error"] == warned.message


def test_a_wrong_parameter_is_an_error(graph, client):
    graph.tracker(client, **QUICK | {"particles": 0})
    report = health(client, lambda h: h.level == "ERROR")
    assert "not tracking: parameter 'particles' is 0" in report.message


def test_lost_frames_are_told_with_the_cure(graph, images):
    camera = graph.client(reliability="BEST_EFFORT")
    graph.tracker(camera, preset="li2007", image_reliability="best_effort")
    began, shown = time.monotonic(), -1

    def report():
        nonlocal shown
        # Each third frame never comes; of the others, best effort may lose some more.
        index = int((time.monotonic() - began) / 0.04)
        if index > shown and index % 3 != 2:
            camera.images.publish(camera.message(images[0], camera.at(index)))
        shown = index
        return [h for h in camera.health if "lost on the way" in h.message]

    told = camera.wait_for(report, "report of lost frames")[0]
    assert told.level == "WARN"
    assert "frames on /image are lost on the way, which best effort allows" in told.message
    assert float(told.values["frame_loss_rate"]) > 0.2
    assert float(told.values["camera_rate"]) == pytest.approx(25.0, rel=0.1)
    status = camera.wait_for(
        lambda: [s for s in camera.statuses if s.values["frame_loss_rate"] != "0.0"], "status"
    )[0]
    assert float(status.values["frame_loss_rate"]) > 0.2


def test_stamps_by_another_clock_have_no_age(graph, client, images):
    graph.tracker(client, **QUICK)
    client.show(images[0], 1_000_000_000)
    report = health(client, lambda h: h.values["frames"] == "1")
    assert report.values["image_age_ms"] == "unknown: the stamps are by another clock"


def test_a_node_that_is_always_busy_says_so(graph, client, images, box):
    # So many that what lies between two frames is little beside them, on a busy machine too.
    graph.tracker(client, preset="zhang2015", particles=30_000, target_box=box)
    numbers = itertools.count()

    def told():
        client.images.publish(client.message(images[0], client.at(next(numbers))))
        return [h for h in client.health if "frames are passed over" in h.message]

    report = client.wait_for(told, "report of overload")[0]
    assert report.level == "WARN"
    assert "take a cheaper preset, fewer particles or smaller images" in report.message


def test_a_node_that_takes_no_images_has_lost_none(graph, images):
    camera = graph.client()
    node = graph.tracker(camera, **QUICK)
    for number in (0, 1, 3, 4, 6, 7, 9, 10, 12, 13, 15, 16, 18, 19):
        camera.show(images[0], camera.at(number))
    node.trigger_deactivate()
    report = health(camera, lambda h: h.values["lifecycle"] == "inactive")
    assert "frame_loss_rate" not in report.values
    assert report.message == "inactive, not tracking"
