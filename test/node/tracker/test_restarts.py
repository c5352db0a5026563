"""Processes that are killed, stopped and restarted at any moment."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
DEADLINE = 60.0
REPLAY = "pf_tracker_ros.node.replay.replay_node"


def tracker(graph, box, *more):
    return graph.process(
        *("-p", "preset:=li2007", "-p", "track.wrong_box_cost:=0.0", "-p", "seed:=4"),
        *("-p", "image_reliability:=reliable", "-p", f"target_box:={box}", *more),
    )


@pytest.mark.slow
def test_a_new_node_tracks_after_one_was_killed(graph, client, images, box):
    for _ in range(2):
        process = tracker(graph, box)
        client.meet()
        client.boxes.clear()
        client.show(images[0], client.at(0))
        client.show(images[1], client.at(1))
        client.box_at(client.at(1))
        process.kill()
        process.wait(DEADLINE)
        client.statuses.clear()
        # DDS keeps the killed process until its lease ends; frames are published all the same.
        client.images.publish(client.message(images[2], client.at(2)))


@pytest.mark.slow
def test_a_new_publisher_is_tracked_after_one_was_killed(
    graph, client, images, box, moving_square_sequence
):
    tracker(graph, box, "-p", "time_jump:=restart")
    client.meet()
    source = ("-p", f"source:={moving_square_sequence}", "-p", "rate:=10.0", "-p", "loop:=true")
    for _ in range(2):
        client.boxes.clear()
        replay = graph.process(*source, module=REPLAY)
        client.wait_for(lambda: len(client.boxes) > 5, "boxes")
        replay.kill()
        replay.wait(DEADLINE)
    # The client's publisher existed all the time.
    assert client.show(images[0], client.at(0)).values["frame"] in ("started", "tracked")


def catches_signals(process):
    """Whether a process has handlers for both signals."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    (caught,) = [int(line.split()[1], 16) for line in lines if line.startswith("SigCgt")]
    return all(caught >> (number - 1) & 1 for number in (signal.SIGINT, signal.SIGTERM))


@pytest.mark.parametrize(
    ("executable", "number"), [("tracker", signal.SIGINT), ("replay", signal.SIGTERM)]
)
def test_a_signal_while_an_executable_is_still_importing_ends_it_with_code_0(
    ros_domain, executable, number
):
    command = f"import sys; from pf_tracker_ros.commands import {executable} as run; "
    process = subprocess.Popen(
        [sys.executable, "-c", command + "sys.exit(run())"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=REPOSITORY,
    )
    end = time.monotonic() + DEADLINE
    while not catches_signals(process):
        assert time.monotonic() < end
    process.send_signal(number)
    output, _ = process.communicate(timeout=DEADLINE)
    assert (process.returncode, "Traceback" in output) == (0, False), output


def test_nodes_in_namespaces_and_a_remapped_node_are_independent(graph, images, box):
    left = graph.client(namespace="/left")
    right = graph.client(namespace="/right")
    quick = {"image_reliability": "reliable", "preset": "li2007", "particles": 20}
    graph.tracker(left, namespace="/left", target_box=box, **quick)
    graph.tracker(right, namespace="/right", **quick | {"particles": 30})
    remapped = graph.tracker(
        cli_args=[
            *("--ros-args", "-r", "image:=/front/image_raw", "-r", "__node:=front_tracker"),
            *("-r", "~/status:=/front/status"),
        ],
        **quick,
    )
    first = left.show(images[0], left.at(0))
    assert (first.name, first.values["frame"]) == ("/left/pf_tracker", "started")
    other = right.show(images[0], right.at(0))
    assert (other.name, other.values["frame"]) == ("/right/pf_tracker", "waiting")
    right.point_at([0.0, 0.0, 20.0, 20.0])
    assert right.show(images[1], right.at(1)).values["particles"] == "30"
    left.set_parameters(particles=25)
    assert left.show(images[1], left.at(1)).values["frame"] == "tracked"
    assert right.show(images[2], right.at(2)).values["particles"] == "30"
    assert {status.name for status in left.statuses} == {"/left/pf_tracker"}
    assert {status.name for status in right.statuses} == {"/right/pf_tracker"}
    names = {endpoint.topic_name for endpoint in (*remapped.publishers, *remapped.subscriptions)}
    assert {"/front/image_raw", "/front/status", "/front_tracker/box"} <= names
    assert not names & {"/image", "/pf_tracker/box", "/pf_tracker/status"}
