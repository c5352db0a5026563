"""`track` gives the same bits as the node for a replay in lockstep."""

import os

import cv2
import pytest
from common import read_boxes
from nodes import box_in, corners, corners_of, stamp_of

from pf_tracker_ros.footage import write_footage
from pf_tracker_ros.footage.opening import open_footage
from pf_tracker_ros.recordings.__main__ import main

DEADLINE = 240.0
# Lockstep waits for the status, not for the test's client. Deep queues let DDS repeat messages that
# the client has lost.
KEPT = {
    f"qos_overrides./pf_tracker/{topic}.publisher.depth": 1000
    for topic in ("status", "box", "particles", "overlay")
}
# Set PF_TRACKER_RUNS for more runs of one bag.
RUNS = int(os.environ.get("PF_TRACKER_RUNS", "1"))


@pytest.fixture
def lockstep(graph, replay):
    """Replay a recording in lockstep into the node; returns the client that recorded its output."""

    def run(tracker, **parameters):
        client = graph.client(particles=True, overlay=True)
        graph.tracker(client, image_reliability="reliable", **KEPT, **tracker)
        # Next to the replay it would be a second camera.
        client.destroy_publisher(client.images)
        node = replay(lockstep=True, **parameters)
        client.wait_for(lambda: not node.context.ok(), "end of the replay", DEADLINE)
        return client

    return run


def assert_same(found, client):
    """The rows of boxes.csv equal the node's messages to the bit."""
    with_box = {int(row["stamp"]): row for row in found if row["x"]}
    # Some messages may still be on their way.
    client.wait_for(lambda: len(client.statuses) >= len(found), "statuses of all frames")
    client.wait_for(lambda: len(client.boxes) >= len(with_box), "all boxes")
    # Node and file both write the shortest text of the same bits.
    assert [
        (status.stamp, status.values["state"], status.values.get("confidence", ""))
        for status in client.statuses
    ] == [(int(row["stamp"]), row["state"], row["confidence"]) for row in found]
    assert {stamp_of(message.header): corners(message) for message in client.boxes} == {
        stamp: corners_of(box_in(row)) for stamp, row in with_box.items()
    }


@pytest.fixture
def source(moving_square_sequence, moving_square, tmp_path, request):
    """The moving square as a recording of the requested kind."""
    kind = request.param
    if kind == "sequence":
        return moving_square_sequence
    if kind == "folder":
        return moving_square_sequence / "img"
    if kind == "uneven video":
        write_clip = request.getfixturevalue("write_clip")
        times = [*range(0, 400, 40), *range(800, 2800, 200)]
        return write_clip(tmp_path / "square.mp4", moving_square.images, times)
    path = tmp_path / "square.mcap"
    write_footage(open_footage(moving_square_sequence), path)
    return path


@pytest.mark.parametrize(
    ("source", "target_box"),
    [
        ("sequence", None),
        ("folder", "20.3,30.7,23.9,24.1"),
        ("uneven video", "20,30,24,24"),
        *[("bag", None)] * RUNS,
    ],
    indirect=["source"],
)
def test_boxes_equal_those_of_a_replay_in_lockstep(lockstep, tmp_path, source, target_box):
    output = tmp_path / "tracked"
    arguments = [str(source), "--output", str(output), "--preset", "li2007", "--seed", "3"]
    target = {"target_from_ground_truth": True}
    if target_box:
        arguments += ["--box", target_box]
        target = {"target_box": [float(value) for value in target_box.split(",")]}
    assert main(arguments) == 0
    client = lockstep({"preset": "li2007", "seed": 3}, source=source, **target)
    found = read_boxes(output)
    assert len(found) == 20
    assert_same(found, client)
    # Guards against comparing a tracker that never moves.
    assert len({row["x"] for row in found}) > 10


def test_compressed_and_broken_images_of_a_bag_are_treated_as_by_the_node(
    lockstep, tmp_path, moving_square, make_stamped, write_bag
):
    messages = []
    for index, image in enumerate(moving_square.images):
        stamp = 1_700_000_000_000_000_000 + index * 33_333_333
        jpeg = cv2.imencode(".jpg", image)[1]
        data = jpeg[: len(jpeg) // 2] if index == 7 else jpeg
        message = make_stamped(
            "sensor_msgs/msg/CompressedImage", stamp, format="jpeg", data=data.ravel()
        )
        messages.append(("/eye/compressed", "sensor_msgs/msg/CompressedImage", stamp, message))
    # One image is repeated, and one is late.
    messages.append((*messages[19][:2], messages[19][2] + 1, messages[19][3]))
    bag = write_bag(tmp_path / "bag", messages)
    output = tmp_path / "tracked"
    box = "20,30,24,24"
    assert main([str(bag), "--output", str(output), "--box", box, "--preset", "li2007"]) == 0
    found = read_boxes(output)
    assert len(found) == 21
    assert [row["state"] for row in found].count("skipped") == 2
    assert found[7]["state"] == found[20]["state"] == "skipped"
    assert found[7]["x"] == found[7]["confidence"] == ""
    tracker = {"preset": "li2007", "image_transport": "compressed"}
    assert_same(found, lockstep(tracker, source=bag, target_box=[20.0, 30.0, 24.0, 24.0]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["otb_jogging_1", "ir_drone_074"])
def test_real_sequences_equal_a_replay_in_lockstep(lockstep, tmp_path, sequences_directory, name):
    source, output = sequences_directory / name, tmp_path / "tracked"
    assert main([str(source), "--output", str(output)]) == 0
    client = lockstep({}, source=source, target_from_ground_truth=True)
    assert_same(read_boxes(output), client)
