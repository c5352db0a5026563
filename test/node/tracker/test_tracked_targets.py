"""The command `track` gives the results of the node in lockstep, for several targets."""

import numpy as np
import pytest
from common import read_boxes
from nodes import box_in
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.recordings.__main__ import main

# The default maximum of `track`.
MULTI_TARGET = {"max_targets": 32, "image_reliability": "reliable", "seed": 3, "preset": "li2007"}
GIVEN = ("--seed", "3", "--preset", "li2007")
# Values that differ between runs.
TIMES = {"processing_time_ms"}


@pytest.fixture
def lockstep(graph, client):
    """A function that shows a recording's images to a tracker, with the stamps of boxes.csv."""
    kinds = {"boxes": MarkerArray, "particles": PointCloud2, "overlay": Image}
    received = {name: client.collect(kind, f"pf_tracker/{name}") for name, kind in kinds.items()}

    def run(folder, images, given=(), **parameters):
        graph.tracker(client, **MULTI_TARGET, **parameters)
        stamps = sorted({int(row["stamp"]) for row in read_boxes(folder)})
        assert len(stamps) == len(images)
        for number, (image, stamp) in enumerate(zip(images, stamps, strict=True)):
            for box, frame in given:
                if frame == number:
                    client.point_at(box, stamp)
            client.show(image, stamp)
        return client, received

    return run


@pytest.fixture
def source(walkers, write_sequence):
    """The walkers as a folder of images."""
    images, boxes = walkers
    return write_sequence("walkers", images, np.array(boxes)[:, 0]) / "img"


def outline(row):
    x, y, width, height = box_in(row)
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]


def assert_same(found, client, arrays):
    """The rows of boxes.csv equal the node's messages, to the bit."""
    statuses = {status.stamp: status for status in client.statuses}
    for stamp in {int(row["stamp"]) for row in found}:
        own = [row for row in found if int(row["stamp"]) == stamp and row["id"]]
        published = [one.values for one in statuses[stamp].targets]
        # Both write the shortest text that reads back to the same bits.
        assert [(row["id"], row["state"], row["confidence"]) for row in own] == [
            (values["id"], values["state"], values["confidence"]) for values in published
        ]
        lines = [
            (one.id, [(point.x, point.y) for point in one.points])
            for one in client.answer_of_array(arrays, stamp)
            if one.ns == "boxes"
        ]
        assert [(int(row["id"]), outline(row)) for row in own if row["x"]] == lines


def test_manual_targets_and_the_bag_equal_those_of_the_node(
    lockstep, source, walkers, typestore, assert_equal_fields
):
    from rosbags.rosbag2 import Reader

    images, boxes = walkers
    entries = [(boxes[2][0], 2), (boxes[5][1], 5)]
    text = "".join(f"\n  - {{target_box: {list(box)}, frame: {n}}}" for box, n in entries)
    source.with_name("img.target.yaml").write_text(f"targets:{text}\n")
    output = source.parent / "out"
    assert main([str(source), "--output", str(output), *GIVEN, "--bag"]) == 0
    client, received = lockstep(output, images, entries)
    found = read_boxes(output)
    assert_same(found, client, received["boxes"])
    assert [row["id"] for row in found] == [""] * 2 + ["1"] * 3 + ["1", "2"] * 11
    recorded = {}
    with Reader(output / "topics.mcap") as reader:
        for connection, _, data in reader.messages():
            message = typestore.deserialize_cdr(data, connection.msgtype)
            name = connection.topic.removeprefix("/pf_tracker/")
            recorded.setdefault(name, []).append(message)
    # `box` is of the selected target; of several manual targets, none is selected.
    assert recorded.keys() == {*received, "status"}
    assert client.boxes == []
    for name in received:
        count = len(recorded[name])
        client.wait_for(lambda name=name, n=count: len(received[name]) >= n, f"all of {name}")
        assert len(received[name]) == count
        for one, other in zip(recorded[name], received[name], strict=True):
            assert_equal_fields(one, other)
    for message, status in zip(recorded["status"], client.statuses, strict=True):
        own, *targets = message.status
        assert (own.name, own.message) == (status.name, status.message)
        for one, published in zip((own, *targets), (status, *status.targets), strict=True):
            values = {pair.key: pair.value for pair in one.values}
            assert (one.name, values.keys()) == (published.name, published.values.keys())
            assert {key for key in values if values[key] != published.values[key]} <= TIMES
