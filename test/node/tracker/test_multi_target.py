"""Several manual targets in a live node: started, selected, published, stopped."""

import pytest
from nodes import corner, ids
from std_srvs.srv import Trigger

from pf_tracker_ros.stamps import stamp_of

MULTI_TARGET = {"max_targets": 4, "image_reliability": "reliable"}


@pytest.fixture
def start_two(graph, client, walkers):
    """A function that starts a tracker and two targets; returns it and the status of the frame."""

    def start():
        images, boxes = walkers
        node = graph.tracker(client, **MULTI_TARGET)
        for box in boxes[0]:
            client.point_at(box)
        return node, client.show(images[0], client.at(0))

    return start


def test_box_and_values_are_of_the_selected_target_only(client, start_two, walkers, send_id, capfd):
    images, boxes = walkers
    node, status = start_two()
    assert (status.level, status.message) == ("OK", "tracking 2 targets")
    assert status.values["selected"] == "0"
    assert "confidence" not in status.values
    for number, id in ((1, 2), (2, 1)):
        send_id(client, node, "select", id)
        status = client.show(images[number], client.at(number))
        assert (status.level, status.message) == ("OK", "tracking")
        assert status.values["selected"] == str(id)
        own = status.targets[id - 1].values
        for name in ("state", "confidence", "covariance_xx", "effective_sample_size"):
            assert status.values[name] == own[name]
        found = corner(client.box_at(client.at(number)))
        assert found == pytest.approx(boxes[number][id - 1][:2], abs=6)
    send_id(client, node, "select", 7)
    status = client.show(images[3], client.at(3))
    refused = "not selected: no target has the id 7; there are: 1, 2"
    assert (status.level, status.message, status.values["selected"]) == ("WARN", refused, "1")
    # The log has the states of the selected one.
    for number in range(4, 10):
        hidden = images[number].copy()
        hidden[30:90] = 128
        status = client.show(hidden, client.at(number))
    assert status.values["state"] == "occluded"
    log = capfd.readouterr().err
    assert log.count("target 1 started on the box (30, 40, 24, 40)") == 1
    assert log.count("tracking -> occluded, confidence ") == 1
    send_id(client, node, "select", 0)
    status = client.show(images[10], client.at(10))
    assert (status.values["selected"], "confidence" in status.values) == ("0", False)
    client.show(images[11], client.at(11))
    stamps = {stamp_of(box.header) for box in client.boxes}
    assert not stamps & {client.at(0), client.at(10), client.at(11)}


def test_one_target_is_stopped_by_its_id_or_all(client, start_two, walkers, send_id):
    images, boxes = walkers
    node, _ = start_two()
    send_id(client, node, "stop_target", 7)
    status = client.show(images[1], client.at(1))
    assert "not stopped: no target has the id 7; there are: 1, 2" in status.message
    send_id(client, node, "stop_target", 2)
    assert ids(client.show(images[2], client.at(2))) == [1]
    assert client.ask(Trigger, "stop").message == "stopped 1 target; waiting for a target"
    status = client.show(images[3], client.at(3))
    assert (status.values["state"], status.values["frame"]) == ("idle", "waiting")
    client.point_at(boxes[4][0])
    assert ids(client.show(images[4], client.at(4))) == [3]
