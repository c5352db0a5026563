"""The selected target of a live node: its box, values, likelihood and log."""

import pytest
from nodes import corner

MULTI_TARGET = {"max_targets": 4, "image_reliability": "reliable"}


@pytest.fixture
def two(graph, client, walkers):
    """A node with two targets after a frame, none selected."""
    images, boxes = walkers
    node = graph.tracker(client, **MULTI_TARGET)
    for box in boxes[0]:
        client.point_at(box)
    client.show(images[0], client.at(0))
    return node


def stamps(client):
    return [box.header.stamp.sec * 10**9 + box.header.stamp.nanosec for box in client.boxes]


def test_box_and_values_are_of_the_selected_target_only(two, client, walkers, send_id):
    images, boxes = walkers
    status = client.show(images[1], client.at(1))
    assert (status.values["selected"], status.values["targets"]) == ("0", "2")
    assert "confidence" not in status.values
    for number, id in ((2, 2), (3, 1)):
        send_id(client, two, "select", id)
        status = client.show(images[number], client.at(number))
        assert (status.level, status.message) == ("OK", "tracking")
        assert status.values["selected"] == str(id)
        own = status.targets[id - 1].values
        for name in ("state", "confidence", "covariance_xx", "effective_sample_size"):
            assert status.values[name] == own[name]
        found = corner(client.box_at(client.at(number)))
        assert found == pytest.approx(boxes[number][id - 1][:2], abs=6)
    send_id(client, two, "select", 0)
    status = client.show(images[4], client.at(4))
    assert (status.values["selected"], status.message) == ("0", "tracking 2 targets")
    assert "confidence" not in status.values
    assert stamps(client) == [client.at(2), client.at(3)]


def test_an_unknown_id_is_refused(two, client, walkers, send_id):
    images, _ = walkers
    send_id(client, two, "select", 2)
    send_id(client, two, "select", 7)
    status = client.show(images[1], client.at(1))
    assert status.level == "WARN"
    assert status.message == "not selected: no target has the id 7; there are: 1, 2"
    assert status.values["selected"] == "2"


def test_the_log_has_the_state_of_the_selected_target(capfd, two, client, walkers, send_id):
    images, _ = walkers
    send_id(client, two, "select", 1)
    for number in range(1, 7):
        image = images[number].copy()
        image[30:90] = 128
        status = client.show(image, client.at(number))
    assert status.values["state"] == "occluded"
    log = capfd.readouterr().err
    assert log.count("target 1 started on the box (30, 40, 24, 40)") == 1
    assert log.count("ids of the targets: 1, 2\n") == 1
    assert log.count("tracking -> occluded, confidence ") == 1
