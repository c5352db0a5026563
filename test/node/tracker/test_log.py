"""The log of the node, at start-up and while it tracks."""

from nodes import QUICK
from std_srvs.srv import SetBool, Trigger


def test_services_are_logged_with_their_results(graph, client, images, box, capfd):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    for service_type, name, request in (
        (SetBool, "enable", {"data": False}),
        (SetBool, "enable", {"data": True}),
        (Trigger, "stop", {}),
        (Trigger, "stop", {}),
    ):
        client.ask(service_type, name, **request)
    log = capfd.readouterr().err
    lines = [
        "paused: images are skipped",
        "tracking resumed",
        "stopped 1 target; waiting",
        "no target to stop",
    ]
    places = [log.index(text) for text in lines]
    assert places == sorted(places)


def test_a_node_that_waits_for_a_lifecycle_manager_is_logged(graph, capfd):
    graph.tracker(autostart=False, **QUICK)
    assert "waiting to be configured and activated" in capfd.readouterr().err


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


def test_a_change_of_the_reliability_is_logged(graph, capfd):
    # A camera that is known before the subscription needs no change.
    graph.tracker()
    camera = graph.client(reliability="BEST_EFFORT")
    log = []

    def is_logged():
        log.append(capfd.readouterr().err)
        return "subscribed to /image with best-effort delivery" in "".join(log)

    camera.wait_for(is_logged, "the new reliability in the log")
