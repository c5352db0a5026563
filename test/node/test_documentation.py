"""The documents agree with the node: topics, services, encodings, parameters."""

import re
from pathlib import Path

from pf_tracker_ros.decoding.image_decoding import ENCODINGS
from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

REPOSITORY = Path(__file__).resolve().parents[2]
NODE = (REPOSITORY / "docs" / "node.md").read_text()


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
    node = LocalizerNode(context=graph.context())
    graph.run(node)
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
