"""The display configurations in config/ use existing topics and services."""

import json
import re
from pathlib import Path

import pytest
import yaml

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture
def offered(graph):
    node = graph.tracker()
    topics = {endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)}
    return topics | {"/pf_tracker/stop", "/pf_tracker/enable"}


def named(value):
    """All names of topics and services in a configuration."""
    if isinstance(value, dict):
        return set().union(*(named(part) for part in value.values()), set())
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


def test_foxglove_shows_topics_and_calls_services_of_the_node(offered):
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text())
    names = named(layout["configById"])
    assert names <= offered
    assert {"/pf_tracker/overlay", "/diagnostics", "/pf_tracker/stop"} <= names
    assert panels(layout["layout"]) == set(layout["configById"])
    target = json.loads(layout["configById"]["Publish!target"]["value"])
    assert len(target["polygon"]["points"]) == 2
