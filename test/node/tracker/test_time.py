"""Stamps that jump or repeat, and simulated time, in a live node."""

from nodes import NEVER_OCCLUDED as QUICK
from rosgraph_msgs.msg import Clock


def test_a_time_jump_is_a_warning_only_with_a_target(graph, client, images, box, capfd):
    graph.tracker(client, **QUICK)
    client.show(images[0], client.at(30))
    client.show(images[0], client.at(0))
    assert "time went back by 1.200 s\n" in capfd.readouterr().err
    client.point_at(box)
    client.show(images[0], client.at(1))
    client.show(images[0], client.at(31))
    client.show(images[0], client.at(1))
    assert (
        "time went back by 1.200 s; 'time_jump' is 'keep'; use 'restart'" in capfd.readouterr().err
    )
    client.report(lambda report: report.values["time_jumps"] == "2")


def test_the_threshold_of_a_jump_can_change_at_run_time(graph, client, images, box):
    graph.tracker(client, target_box=box, time_jump="wait", **QUICK)
    client.show(images[0], client.at(20))
    assert client.show(images[1], client.at(0)).values["frame"] == "late"
    assert client.set_parameters(time_jump_threshold=0.1).successful
    assert client.show(images[1], client.at(0)).values["frame"] == "waiting"


def test_dropped_frames_are_counted_by_cause(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(5))
    client.show(images[0], client.at(5))
    client.show(images[0], client.at(4))
    client.show(images[0], client.at(3))
    client.show(images[0], client.at(6), "no_encoding")

    names = ("dropped_duplicate", "dropped_late", "dropped_refused", "refused_encoding")
    client.report(lambda report: [report.values.get(name) for name in names] == [*"1211"])


def test_simulated_time_stamps_the_diagnostics_and_may_jump_back(graph, client, images, box):
    graph.tracker(client, target_box=box, use_sim_time=True, time_jump="wait", **QUICK)
    clock = client.create_publisher(Clock, "/clock", 10)
    client.wait_for(clock.get_subscription_count, "subscription to the clock")

    def tick(seconds):
        message = Clock()
        message.clock.sec = seconds

        def stamped():
            # Published repeatedly: messages before the connection are lost.
            clock.publish(message)
            return client.health and client.health[-1].stamp == seconds * 10**9

        client.wait_for(stamped, "stamp")

    tick(100)
    assert client.show(images[0], 100 * 10**9).values["frame"] == "started"
    client.health.clear()
    tick(101)
    age = [h.values["image_age_ms"] for h in client.health if "image_age_ms" in h.values]
    assert float(age[-1]) == 0.0
    assert client.show(images[1], 101 * 10**9).values["frame"] == "tracked"
    tick(7)
    assert client.show(images[0], 7 * 10**9).values["frame"] == "waiting"


def test_dropped_frames_are_not_decoded(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
    assert client.show(images[1], client.at(1)).values["frame"] == "tracked"
    # If it were decoded, it would be refused.
    for stamp, frame in ((client.at(1), "duplicate"), (client.at(0.5), "late")):
        broken = client.message(images[2], stamp)
        broken.data = broken.data[:100]
        assert client.send(broken).values["frame"] == frame
    assert client.show(images[2], client.at(2)).values["frame"] == "tracked"
