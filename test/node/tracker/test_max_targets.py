"""Changes of `max_targets` while targets are tracked."""

import pytest
from nodes import ids
from rclpy.parameter import Parameter

from pf_tracker_ros.tracking.presets import preset_parameters

RELIABLE = {"image_reliability": "reliable"}


def test_a_larger_number_keeps_the_target_and_its_selection(graph, client, walkers):
    images, boxes = walkers
    graph.tracker(client, target_box=list(boxes[0][0]), **RELIABLE)
    client.show_all(images[:3])
    assert client.set_parameters(max_targets=3).successful
    assert client.tunables() == preset_parameters("default", 3)
    client.point_at(boxes[3][1])
    status = client.show(images[3], client.at(3))
    assert (status.values["frame"], ids(status), status.values["selected"]) == (
        "started",
        [1, 2],
        "1",
    )
    for number in range(4, 8):
        status = client.show(images[number], client.at(number))
        assert (status.level, status.values["preset"], ids(status)) == ("OK", "default", [1, 2])
    corner = client.box_at(client.at(7)).polygon.points[0]
    assert (corner.x, corner.y) == pytest.approx(boxes[7][0][:2], abs=6)
    request = {"target_box": [0.0, 0.0, 30.0, 30.0], "max_targets": 2}
    assert client.set_parameters(**request).successful
    status = client.show(images[8], client.at(8))
    assert "target refused: there are 2 targets" in status.message


def test_values_set_with_it_are_kept_in_any_order(graph, client, capfd):
    graph.tracker(client, **RELIABLE)
    given = {"particles": 31, "detector.labels": ["dog"], "max_targets": 4}
    requests = [Parameter(name, value=value) for name, value in given.items()]
    results = client.call(client.parameters.set_parameters, requests).results
    assert all(result.successful for result in results)
    expected = preset_parameters("default", 4) | {"particles": 31, "detector.labels": ("dog",)}
    assert client.tunables() == expected
    assert "preset default, 2 values changed: particles 31 instead of 100" in capfd.readouterr().err
    assert client.set_parameters(max_targets=2).successful
    assert client.tunables() == expected | {"max_targets": 2}
    # The parameters that describe the detector are not reset.
    assert client.set_parameters(max_targets=1).successful
    assert client.tunables() == preset_parameters("default") | {"detector.labels": ("dog",)}


def test_it_is_set_first_if_a_request_is_not_applied_as_a_whole(graph, client):
    graph.tracker(client, **RELIABLE)
    # The motion model contradicts the proposal, so the parameters are set one by one.
    given = {"particles": 31, "motion.model": "affine", "max_targets": 4}
    requests = [Parameter(name, value=value) for name, value in given.items()]
    results = client.call(client.parameters.set_parameters, requests).results
    assert [result.successful for result in results] == [True, False, True]
    assert client.tunables() == preset_parameters("default", 4) | {"particles": 31}
