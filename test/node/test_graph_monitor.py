"""A node whose name another one has."""

import pytest
import rclpy

from pf_tracker_ros.node import graph_monitor

SAID = "another node is called /pf_tracker, too"


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.02)


def test_another_node_of_the_same_name_is_told_of_as_long_as_it_is_there(graph, capfd):
    client = graph.client()
    graph.tracker(client)
    other = rclpy.create_node("pf_tracker", context=graph.context())
    report = client.wait_for(
        lambda: client.health and SAID in client.health[-1].message and client.health[-1], "report"
    )
    assert "-r __node:=another_name" in report.message
    assert report.values["last_error"].startswith(SAID)
    other.destroy_node()
    other.context.shutdown()
    client.wait_for(lambda: SAID not in client.health[-1].message, "silence")
    assert capfd.readouterr().err.count(SAID) == 1


def test_a_node_of_the_same_name_in_another_namespace_is_none(graph):
    other = rclpy.create_node("pf_tracker", namespace="/left", context=graph.context())
    client = graph.client()
    graph.tracker(client)
    theirs = (other.get_name(), other.get_namespace())
    client.wait_for(lambda: theirs in client.get_node_names_and_namespaces(), "the other one")
    before = len(client.health)
    client.wait_for(lambda: len(client.health) >= before + 2, "two reports")
    assert not any(SAID in report.message for report in client.health)
