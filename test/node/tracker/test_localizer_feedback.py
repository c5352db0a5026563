"""The tracker takes what a localizer knows of its targets."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode
from pf_tracker_ros.node.tracker.target_subscriptions import localizer_hints
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.hints import Hint, Standing
from pf_tracker_ros.tracking.presets import preset_parameters

SHARE = 0.5


def localizer_status(tracker_status, **values):
    own = DiagnosticStatus(values=[KeyValue(key="tracker_status", value=tracker_status)])
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticArray(status=[own, DiagnosticStatus(values=pairs)])


def test_only_hints_about_the_trackers_own_targets_are_read():
    status = localizer_status(
        "/pf_tracker/status",
        id=3,
        covered_share=0.25,
        expected_x=1.0,
        expected_y=2.0,
        expected_width=3.0,
        expected_height=4.0,
        expected_center_std=5.0,
        horizon=6.0,
        height_slope=7.0,
        place_odds=-1.0,
    )
    hint = Hint(0.25, (1.0, 2.0, 3.0, 4.0), 5.0, Standing(6.0, 7.0), -1.0)
    assert localizer_hints(status, "/pf_tracker/status") == {3: hint}
    assert localizer_hints(status, "/other/status") == {}
    assert localizer_hints(localizer_status("/a", id=3), "/a") == {3: Hint()}
    assert localizer_hints(DiagnosticArray(), "/a") == {}
    for values in ({"id": 3, "covered_share": "near"}, {"covered_share": 0.5}):
        with pytest.raises(ValueError, match="a target of the localizer cannot be read"):
            localizer_hints(localizer_status("/a", **values), "/a")


@pytest.fixture
def localizer(graph):
    height = Parameter("camera.height", value=1.2)
    node = LocalizerNode(context=graph.context(), parameter_overrides=[height])
    graph.run(node)
    return node


def test_the_tracker_takes_the_share_that_a_localizer_measures(
    graph, client, localizer, images, box
):
    """The share of a frame counts in the next one, by its odds."""
    infos = client.create_publisher(CameraInfo, "camera_info", 10)
    depths = client.create_publisher(Image, "depth", 10)
    node = graph.tracker(client, target_box=box, image_reliability="reliable")
    client.wait_for(
        lambda: "/localizer/status" in [s.topic_name for s in node.subscriptions], "localizer"
    )
    graph.introduce(client, localizer, node)
    k = [80.0, 0.0, 79.5, 0.0, 80.0, 59.5, 0.0, 0.0, 1.0]
    infos.publish(CameraInfo(width=160, height=120, distortion_model="plumb_bob", d=[0.0] * 5, k=k))
    client.wait_for(lambda: localizer._inputs.camera_info.arrivals.count, "calibration")

    def show(index, covered):
        """Show a frame, of whose box the left part is covered; returns the confidence."""
        x, y, side = 20 + 4 * index, 30 + 2 * index, 24
        depth = np.full((120, 160), 9.0, np.float32)
        depth[y : y + side, x : x + side] = 4.0
        depth[:, : round(x + covered * side)] = 2.0 if covered else 9.0
        depths.publish(client.message(depth, client.at(index), "32FC1"))
        client.wait_for(lambda: localizer._inputs.depth.arrivals.count > index, "depth")
        status = client.show(images[index], client.at(index))
        session = node._manager.session
        client.wait_for(lambda: session._hints[0] == client.at(index), "share")
        hints.append(session._hints[1][1])
        return float(status.values["confidence"])

    def confidences(given):
        """Of a session of the library, by the hint of each frame."""
        session = Session(preset_parameters("default"), seed=0)
        session.request(box)
        for index, hint in enumerate(given):
            yield session.process(Frame(images[index], client.at(index))).estimate.confidence
            session.set_hints({1: hint}, client.at(index))

    hints = []
    told = [show(index, SHARE if index == 2 else 0.0) for index in range(4)]
    shares = [hint.covered_share for hint in hints]
    assert shares == pytest.approx([0.0, 0.0, SHARE, 0.0], abs=0.05)
    assert told == pytest.approx([*confidences(hints)], rel=1e-4)
    *_, plain = confidences([hint._replace(covered_share=0.0) for hint in hints])
    assert told[3] < plain
