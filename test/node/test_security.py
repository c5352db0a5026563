"""The policy in config/ allows a live node exactly what it needs."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode

REPOSITORY = Path(__file__).resolve().parents[2]
# Only with vision_msgs, simulated time or another transport.
OPTIONAL = {
    "/pf_tracker/detections",
    "/detections",
    "/clock",
    "/image/compressed",
    "/parameter_events",
    "/localizer/detections_3d",
    "/depth/compressed",
    "/depth/compressedDepth",
    # Once there is depth.
    "/pf_tracker/target_probability",
    "/tf",
    "/tf_static",
}


def allowed(name, kind, permission):
    """Full names that the policy allows a node in the root namespace."""
    root = ElementTree.parse(REPOSITORY / "config" / "sros2_policy.xml").getroot()
    (profile,) = [one for one in root.iter("profile") if one.get("node") == name]
    names = {
        item.text.strip()
        for group in profile.iter(f"{kind}s")
        if group.get(permission) == "ALLOW"
        for item in group.iter(kind)
    }
    assert all(name for name in names)
    return {one.replace("~", f"/{name}") if "~" in one else "/" + one.lstrip("/") for one in names}


def used(node, query):
    """Full names that a node uses, as it sees itself in the graph."""
    if node.get_name() not in node.get_node_names():
        return set()
    found = getattr(node, query)(node.get_name(), node.get_namespace())
    return {name for name, _ in found}


@pytest.mark.parametrize("name", ["pf_tracker", "localizer"])
@pytest.mark.parametrize(
    ("kind", "permission", "query"),
    [
        ("topic", "publish", "get_publisher_names_and_types_by_node"),
        ("topic", "subscribe", "get_subscriber_names_and_types_by_node"),
        ("service", "reply", "get_service_names_and_types_by_node"),
    ],
)
def test_the_policy_allows_what_the_node_uses(graph, name, kind, permission, query):
    client = graph.client()
    if name == "localizer":
        node = LocalizerNode(context=graph.context())
        graph.run(node)
    else:
        node = graph.tracker(client, image_reliability="reliable")
    names = allowed(name, kind, permission)
    client.wait_for(lambda: names - OPTIONAL <= used(node, query), "endpoints")
    assert used(node, query) <= names


def test_a_node_does_not_start_without_the_required_security(ros_domain, tmp_path):
    settings = {
        "ROS_SECURITY_KEYSTORE": str(tmp_path),
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
    }
    process = subprocess.run(
        [
            *(sys.executable, "-m", "pf_tracker_ros.node.tracker.tracker_node"),
            *("--ros-args", "--enclave", "/pf_tracker"),
        ],
        cwd=REPOSITORY,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 1
    assert "SECURITY ERROR" in process.stderr
    assert "Traceback" not in process.stderr
