"""Several manual targets in a live node: started, published, stopped, changed."""

import numpy as np
import pytest
from nodes import ids
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.overlay import target_color

MULTI_TARGET = {"max_targets": 4, "image_reliability": "reliable"}


@pytest.fixture
def start_tracker(graph, client):
    """A function that starts a tracker, and returns it and the messages of some topics."""

    def start(topics=(), **parameters):
        kinds = {"boxes": MarkerArray, "particles": PointCloud2, "overlay": Image}
        received = {name: [] for name in topics}
        for name in topics:
            client.create_subscription(
                kinds[name], f"pf_tracker/{name}", received[name].append, 100
            )
        return graph.tracker(client, **{**MULTI_TARGET, **parameters}), received

    return start


def two_targets(client, walkers, stamp=0):
    images, boxes = walkers
    for box in boxes[0]:
        client.point_at(box, stamp)
    return client.show(images[0], client.at(0))


def test_each_request_starts_another_target(client, start_tracker, walkers):
    images, _ = walkers
    start_tracker()
    status = two_targets(client, walkers)
    assert (status.level, status.values["frame"]) == ("OK", "started")
    assert (status.values["state"], status.values["targets"]) == ("tracking", "2")
    assert status.message == "tracking 2 targets"
    assert [one.name for one in status.targets] == [
        "/pf_tracker: target 1",
        "/pf_tracker: target 2",
    ]
    for number in range(1, 6):
        status = client.show(images[number], client.at(number))
    assert ids(status) == [1, 2]
    for one in status.targets:
        assert (one.level, one.values["state"], one.values["label"]) == ("OK", "tracking", "")
        assert float(one.values["age"]) == pytest.approx(0.2)
        assert 0.0 < float(one.values["confidence"]) <= 1.0
    # Without a selected target there are no values of a single one.
    assert client.boxes == []
    assert status.values["selected"] == "0"
    assert "confidence" not in status.values


def test_particles_and_overlay_show_all(client, start_tracker, walkers):
    images, _ = walkers
    _, received = start_tracker(["particles", "overlay"])
    two_targets(client, walkers)
    client.show(images[1], client.at(1))
    cloud = client.answer(received["particles"], client.at(1))
    assert [one.name for one in cloud.fields][-1] == "id"
    points = np.frombuffer(cloud.data, np.float32).reshape(cloud.width, -1)
    assert set(points[:, -1]) == {1.0, 2.0}
    for id in (1.0, 2.0):
        assert points[points[:, -1] == id, 5].sum() == pytest.approx(1.0, abs=1e-3)
    overlay = decode_raw(client.answer(received["overlay"], client.at(1)))
    for id in (1, 2):
        assert (overlay == target_color(id)).all(axis=2).sum() > 50


def test_one_target_is_stopped_by_its_id_or_all(client, start_tracker, walkers, send_id):
    images, boxes = walkers
    node, _ = start_tracker()
    two_targets(client, walkers)
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
