"""`watch` prints what a real tracker publishes."""

import itertools
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from pf_tracker_ros.node.watch import watch_node
from pf_tracker_ros.node.watch.watch_node import WatchNode, lines


def status(message="", **values):
    items = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(message=message, values=items)


def texts(*statuses):
    return [text for _, _, text in lines(DiagnosticArray(status=statuses))]


BOX = {"box_x": "20.0", "box_y": "30.04", "box_width": "24", "box_height": "25.5"}


def test_a_line_has_state_confidence_and_box_with_its_reason_or_position():
    target = status("tracking", id="3", label="person", state="tracking", confidence="0.938", **BOX)
    hidden = status("the box is uncertain", id="4", state="occluded", confidence="0.91", **BOX)
    box = "box 24.0 x 25.5 px, top left at 20.0, 30.0"
    assert texts(status(), target, hidden) == [
        f"target 3 person  tracking 0.94  {box}",
        f"target 4  occluded 0.91  {box}; the box is uncertain",
    ]
    place = {"x": "2.312", "y": "-0.4", "velocity_x": "0.8", "velocity_y": "0"}
    located = status("located", id="3", label="", state="occluded", confidence="0.5", **place)
    assert texts(status(), located) == ["target 3  occluded 0.50  at 2.31, -0.40 m, 0.80, 0.00 m/s"]


def test_without_a_target_or_a_position_the_line_has_the_reason():
    assert texts(status("waiting for a target", state="idle")) == [
        "no target: waiting for a target"
    ]
    unknown = status("no depth", id="1", label="", state="lost", confidence="x")
    assert texts(status(), unknown) == ["target 1  lost ?  no depth"]
    assert texts() == ["no target: "]


@pytest.fixture
def watch(graph, client, box, monkeypatch):
    """A function that prints a real tracker with a target, and returns the lines so far."""
    printed = []
    monkeypatch.setattr(
        watch_node, "print", lambda line, flush: printed.append(line), raising=False
    )

    def run(rate):
        tracker = graph.tracker(client, preset="li2007", particles=20)
        watch = WatchNode(rate=rate, context=graph.context())
        graph.run(watch)
        graph.introduce(client, tracker, watch)
        client.point_at(box)
        return printed

    return run


def test_it_prints_each_frame_of_a_real_tracker(watch, client, images):
    printed = watch(0.0)
    for index, image in enumerate(images[:5]):
        client.show(image, client.at(index))
        # It keeps few messages that it has not printed yet.
        client.wait_for(lambda count=index + 1: len(printed) == count, "line")
    place = "box 24.0 x 24.0 px, top left at 20.0, 30.0"
    assert printed[0] == f"{client.at(0) / 1e9:.3f}  target 1  tracking 1.00  {place}"


def test_it_prints_so_many_lines_a_second(watch, graph, client, images):
    printed = watch(0.001)
    client.show_all(images[:5])
    client.wait_for(lambda: printed, "line")
    graph.close()
    assert len(printed) == 1


def test_once_ends_with_the_first_target(graph, client, images, box):
    code = "import pf_tracker_ros.commands as c; c.watch()"
    graph.tracker(client, preset="li2007", particles=20)
    process = graph.command(sys.executable, "-c", code, "--once")
    client.point_at(box)
    client.show_all(images)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "target 1  tracking" in output


def test_it_ends_quietly_with_the_reader_of_its_output(graph, client, images, box):
    code = "import pf_tracker_ros.commands as c; c.watch()"
    command = 'set -o pipefail; "$0" -c "$1" --rate 0 | head -2'
    graph.tracker(client, preset="li2007", particles=20)
    process = graph.command("bash", "-c", command, sys.executable, code)
    client.point_at(box)
    indices = itertools.count()

    def has_ended():
        client.show(images[0], client.at(next(indices)))
        return process.poll() is not None

    client.wait_for(has_ended, "end")
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    assert len(output.splitlines()) == 2, output
    assert output.count("target 1  tracking") == 2


def test_a_missing_tracker_is_reported(graph, monkeypatch, capfd):
    monkeypatch.setattr("pf_tracker_ros.node.watch.watch_node._SILENCE", 0.1)
    client = graph.client()
    graph.run(WatchNode(context=graph.context()))
    client.wait_for(
        lambda: "no status on /pf_tracker/status: start a tracker" in capfd.readouterr().err,
        "warning",
    )
