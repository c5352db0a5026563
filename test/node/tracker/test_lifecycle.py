"""The node under a lifecycle manager."""

import os
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nodes import NEVER_OCCLUDED as QUICK

CYCLE = ("CONFIGURE", "ACTIVATE", "DEACTIVATE", "CLEANUP")
CYCLES = 200


class Manager:
    """Drives the lifecycle of a node by its services."""

    def __init__(self, client):
        self._client = client

    def change(self, name):
        transition = Transition(id=getattr(Transition, f"TRANSITION_{name}"))
        return self._client.ask(ChangeState, "change_state", transition=transition).success

    @property
    def state(self):
        return self._client.ask(GetState, "get_state").current_state.label


@pytest.fixture
def manager(client):
    return Manager(client)


def topics(node):
    own = [endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)]
    return sorted(name for name in own if name.startswith(("/pf_tracker/", "/image")))


def services(node):
    names = [service.srv_name for service in node.services]
    return sorted(name for name in names if name in ("~/enable", "~/stop"))


INACTIVE = [
    "/pf_tracker/box",
    "/pf_tracker/boxes",
    "/pf_tracker/likelihood",
    "/pf_tracker/overlay",
    "/pf_tracker/particles",
    "/pf_tracker/status",
    "/pf_tracker/target_probability",
]
SUBSCRIBED = [f"/pf_tracker/{name}" for name in ("click", "select", "stop_target", "target")]
ACTIVE = ["/image", *INACTIVE, *SUBSCRIBED]


def test_each_transition_is_undone_by_its_counterpart(graph, client, manager):
    node = graph.tracker(autostart=False, **QUICK)
    assert [manager.change(name) for name in CYCLE[1:]] == [False] * 3
    assert manager.state == "unconfigured"
    seen = [(topics(node), services(node))]
    for name in CYCLE:
        assert manager.change(name), name
        seen.append((topics(node), services(node)))
    detections = [name for name in seen[1][0] if name.endswith("detections")]
    unconfigured = ([], [])
    offered = ["~/enable", "~/stop"]
    inactive = (sorted(INACTIVE + detections), offered)
    active = (sorted(ACTIVE + detections), offered)
    assert seen == [unconfigured, inactive, active, inactive, unconfigured]


def test_a_deactivated_node_keeps_its_target_and_a_cleaned_up_one_forgets_it(
    graph, client, manager, images, box
):
    node = graph.tracker(client, **QUICK)
    assert manager.state == "active"
    client.point_at(box)
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
    assert manager.change("DEACTIVATE")
    client.wait_for(lambda: not client.images.get_subscription_count(), "end of the subscription")
    assert manager.change("ACTIVATE")
    graph.introduce(client, node)
    assert client.show(images[1], client.at(1)).values["frame"] == "tracked"
    for name in ("DEACTIVATE", "CLEANUP", "CONFIGURE", "ACTIVATE"):
        assert manager.change(name)
    graph.introduce(client, node)
    assert client.show(images[2], client.at(2)).values["frame"] == "waiting"


def test_an_invalid_parameter_fails_the_configuration_until_corrected(graph, client, manager):
    graph.tracker(autostart=False, **QUICK | {"particles": 0})
    assert not manager.change("CONFIGURE")
    assert manager.state == "unconfigured"
    health = client.report(lambda report: report.level == "ERROR")
    assert "parameter 'particles' is 0" in health.message
    assert client.set_parameters(particles=10).successful
    assert manager.change("CONFIGURE")
    assert manager.state == "inactive"


def test_parameters_set_in_any_state_take_effect(graph, client, manager, images, box):
    node = graph.tracker(autostart=False, **QUICK)
    assert client.set_parameters(particles=31, preset="zhang2015").successful
    assert manager.change("CONFIGURE")
    assert client.set_parameters(target_box=box, image_transport="compressed").successful
    assert client.set_parameters(image_transport="raw").successful
    assert "/image" not in topics(node)
    assert manager.change("ACTIVATE")
    graph.introduce(client, node)
    status = client.show(images[0], client.at(0))
    assert (status.values["frame"], status.values["particles"]) == ("started", "31")
    assert status.values["preset"] == "zhang2015, 1 value changed"


@pytest.mark.parametrize("state", ["UNCONFIGURED", "ACTIVE"])
def test_a_shutdown_releases_everything(graph, client, manager, state):
    node = graph.tracker(autostart=False, **QUICK)
    for name in CYCLE[: ["UNCONFIGURED", "INACTIVE", "ACTIVE"].index(state)]:
        assert manager.change(name)
    assert manager.change(f"{state}_SHUTDOWN")
    assert manager.state == "finalized"
    assert (topics(node), services(node)) == ([], [])


def test_an_unexpected_error_in_a_transition_cleans_up_the_node(
    graph, client, manager, monkeypatch
):
    node = graph.tracker(autostart=False, **QUICK)
    monkeypatch.setattr(node, "_subscribe", lambda: 1 / 0)
    assert manager.change("CONFIGURE")
    assert not manager.change("ACTIVATE")
    assert manager.state == "unconfigured"
    assert (topics(node), services(node)) == ([], [])
    monkeypatch.undo()
    assert manager.change("CONFIGURE")
    assert manager.change("ACTIVATE")


def resident_bytes():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
def test_cycles_need_no_more_memory(graph, client, manager, images, box):
    node = graph.tracker(autostart=False, target_box=box, **QUICK)

    def cycle():
        for name in CYCLE:
            assert manager.change(name)

    for _ in range(10):
        cycle()
    before, counts = resident_bytes(), [len(list(node.waitables)), len(list(node.guards))]
    for _ in range(CYCLES):
        cycle()
    assert [len(list(node.waitables)), len(list(node.guards))] == counts
    assert resident_bytes() - before < 5_000_000
    for name in ("CONFIGURE", "ACTIVATE"):
        assert manager.change(name)
    graph.introduce(client, node)
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
