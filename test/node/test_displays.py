"""The display configurations in config/ use existing topics and services."""

import json
import re
from pathlib import Path

import pytest
import yaml

from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture
def offered(graph):
    """Topics of tracker and localizer, and the tracker's services."""
    localizer = LocalizerNode(context=graph.context())
    graph.run(localizer)
    topics = {
        endpoint.topic_name
        for node in (graph.tracker(), localizer)
        for endpoint in (*node.publishers, *node.subscriptions)
    }
    return topics | {"/pf_tracker/stop", "/pf_tracker/enable"}


def named(value):
    """All names of topics and services in a configuration."""
    if isinstance(value, dict):
        return set().union(*(named(part) for pair in value.items() for part in pair), set())
    if isinstance(value, list):
        return set().union(*(named(part) for part in value), set())
    return set(re.findall(r"^/\w+(?:/\w+)*", value)) if isinstance(value, str) else set()


def panels(layout):
    """Names of the panels in a tree of panels."""
    if isinstance(layout, str):
        return {layout}
    return panels(layout["first"]) | panels(layout["second"])


def test_rviz_shows_topics_of_the_node(offered):
    configuration = yaml.safe_load((CONFIG / "tracker.rviz").read_text())
    names = named(configuration)
    assert names <= offered
    assert {"/pf_tracker/overlay", "/pf_tracker/particles", "/pf_tracker/click"} <= names


def test_rviz_shows_topics_of_the_localizer(offered):
    names = named(yaml.safe_load((CONFIG / "localizer.rviz").read_text()))
    assert names == {"/localizer/markers", "/localizer/pose"}
    assert names <= offered


def test_foxglove_shows_topics_and_calls_services_of_the_node(offered):
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text())
    names = named(layout["configById"])
    assert names <= offered
    assert {"/diagnostics", "/localizer/markers", "/pf_tracker/stop"} <= names
    assert panels(layout["layout"]) == set(layout["configById"])
    target = json.loads(layout["configById"]["Publish!target"]["value"])
    assert len(target["polygon"]["points"]) == 2
