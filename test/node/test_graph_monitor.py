"""A second node of the same name."""

import pytest
import rclpy

from pf_tracker_ros.node import graph_monitor

FAULT = "another node is named /pf_tracker"


@pytest.fixture(autouse=True)
def _few_fast_polls(fast_reports, monkeypatch):
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.02)
    # The second of two reports on /diagnostics comes after so many.
    monkeypatch.setattr(graph_monitor, "_POLLS_NODE", 5)


def test_a_node_of_the_same_name_is_reported_while_it_exists(graph, capfd):
    client = graph.client()
    graph.tracker(client)
    other = rclpy.create_node("pf_tracker", context=graph.context())
    report = client.wait_for(
        lambda: client.health and FAULT in client.health[-1].message and client.health[-1], "report"
    )
    assert "-r __node:=another_name" in report.message
    assert report.values["last_error"].startswith(FAULT)
    other.destroy_node()
    other.context.shutdown()
    client.wait_for(lambda: FAULT not in client.health[-1].message, "the end of the report")
    assert capfd.readouterr().err.count(FAULT) == 1


def test_a_node_in_another_namespace_is_not_reported(graph):
    other = rclpy.create_node("pf_tracker", namespace="/left", context=graph.context())
    client = graph.client()
    graph.tracker(client)
    theirs = (other.get_name(), other.get_namespace())
    client.wait_for(lambda: theirs in client.get_node_names_and_namespaces(), "the other one")
    before = len(client.health)
    client.wait_for(lambda: len(client.health) >= before + 2, "two reports")
    assert not any(FAULT in report.message for report in client.health)
