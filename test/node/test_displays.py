"""Displays in config/ and documents agree with the nodes: topics, services, encodings."""

import json
import re
from pathlib import Path

import pytest
import yaml

from pf_tracker_ros.decoding.image_decoding import ENCODINGS
from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIG = REPOSITORY / "config"
NODE = (REPOSITORY / "docs" / "node.md").read_text()


def start_localizer(graph):
    node = LocalizerNode(context=graph.context())
    graph.run(node)
    return node


@pytest.fixture
def offered(graph):
    """Topics of tracker and localizer, and the tracker's services."""
    localizer = start_localizer(graph)
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


def test_the_table_lists_the_topics_and_services_of_the_node(graph):
    node = graph.tracker(image_transport="raw")
    endpoints = {endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)}
    own = {name for name in endpoints if name.startswith("/pf_tracker/")} | {"/diagnostics"}
    table = NODE.partition("## Topics and services")[2].partition("\n## ")[0]
    listed = set(re.findall(r"^\| (?:in|out) \| `(\S+)`", table, re.MULTILINE))
    full = {name.replace("~", "/pf_tracker") for name in listed}
    assert own <= full
    optional = {"image", "image/compressed", "detections", "/pf_tracker/detections"}
    # The last one only where there is a localizer.
    assert full - own <= optional | {"localizer/status"}
    services = set(re.findall(r"^\| service \| `(\S+)`", table, re.MULTILINE))
    assert services <= {service.srv_name for service in node.services}


def test_the_table_lists_the_topics_of_the_localizer(graph):
    node = start_localizer(graph)
    text = (REPOSITORY / "docs" / "localizer.md").read_text()
    listed = {
        name.replace("~", "/localizer") if "~" in name else f"/{name.lstrip('/')}"
        for row in re.findall(r"^\| (?:in|out) \| ([^|]+) \|", text, re.MULTILINE)
        for name in re.findall(r"`(\S+)`", row)
    }
    rclpy_own = {"/rosout", "/parameter_events", "/clock", "/localizer/transition_event"}
    endpoints = {one.topic_name for one in (*node.publishers, *node.subscriptions)} - rclpy_own
    assert endpoints <= listed | {"/tf_static"}
    optional = {"/localizer/detections_3d", "/tf"}
    optional |= {"/depth/compressed", "/depth/compressedDepth", "/pf_tracker/target_probability"}
    assert listed - endpoints <= optional


def test_the_table_of_encodings_is_complete():
    table = NODE.partition("| encoding |")[2].partition("\n\n")[0]
    named = set(re.findall(r"`([\w]+)`", table))
    assert set(ENCODINGS) - named == {"bayer_bggr16", "bayer_gbrg16", "bayer_grbg16"}
    assert named <= set(ENCODINGS)
