"""The node's parameters, at start-up and at run time, over the parameter services."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

QUICK = {"particles": 20, "track__wrong_box_cost": 0.0, "image_reliability": "reliable"}
# Including those of rclpy.
MAX_PARAMETERS = 75
KNOWN = declarations(NodeParameters) | declarations(TrackerParameters)


def test_a_node_has_the_parameters_of_all_parts_and_not_too_many(graph, client):
    graph.tracker(client)
    names = client.parameter_names()
    assert sorted(names) == sorted(KNOWN)
    every = client.call(client.parameters.list_parameters).result.names
    assert set(names) < set(every)
    assert len(every) <= MAX_PARAMETERS
    described = client.call(client.parameters.describe_parameters, list(KNOWN)).descriptors
    # The node can change what the library fixes while it tracks: it relearns the target.
    assert [one.name for one in described if one.read_only] == ["autostart"]
    assert all(one.description.startswith(KNOWN[one.name].description) for one in described)


CONTRADICTION = {"proposal__method": "kalman", "motion__model": "constant_velocity"}
# Given at start-up, the correction, and what is reported.
REFUSED = {
    "out of range": (
        {"particles": 0},
        {"particles": 20},
        "parameter 'particles' is 0; allowed: int, 1 to 100000",
    ),
    "no preset of that name": (
        {"preset": "lee2007"},
        {"preset": "li2007"},
        "parameter 'preset' is 'lee2007'; allowed: string, 'default' or 'li2007'",
    ),
    "a contradiction": (
        CONTRADICTION,
        {"motion__model": "affine"},
        "parameter 'proposal.method' is 'kalman' with the motion model 'constant_velocity'",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_an_invalid_parameter_keeps_the_node_idle_until_corrected(  # noqa: PLR0917
    graph, client, images, box, kind, capfd
):
    given, corrected, reason = REFUSED[kind]
    graph.tracker(client, **{"target_box": box, **QUICK, **given})
    for index in range(2):
        status = client.show(images[0], client.at(index))
        assert (status.level, status.values["state"]) == ("ERROR", "idle")
        assert reason in status.message
        assert reason in status.values["last_error"]
    assert capfd.readouterr().err.count(reason) == 1
    client.point_at(box)
    status = client.show(images[0], client.at(2))
    assert "target refused: not tracking" in status.message

    assert client.set_parameters(**corrected).successful
    status = client.show(images[1], client.at(3))
    assert (status.level, status.values["frame"]) == ("OK", "started")
    client.box_at(client.at(3))
    assert len(client.boxes) == 1
    if kind == "no preset of that name":
        assert client.tunables() == preset_parameters("li2007")


def test_an_unknown_parameter_is_reported_and_the_node_tracks(graph, client, images, box):
    graph.tracker(client, target_box=box, particels=50, **QUICK)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["frame"]) == ("WARN", "started")
    assert "no parameter 'particels' (did you mean 'particles'?)" in status.message


def test_parts_are_chosen_and_tuned_at_start_up(graph, client, images, box):
    chosen = {
        "proposal__method": "kalman",
        "motion__model": "affine",
        "cues": ["hog", "color_histogram"],
    }
    values = {"hog__sharpness": 90, "motion__drift": [1, 0]}
    graph.tracker(client, target_box=box, **values, **chosen, **QUICK)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["frame"]) == ("OK", "started")
    names = ["cues", "hog.sharpness", "motion.drift", "motion.factor", "proposal.share"]
    assert client.get_parameters(*names) == [
        ("hog", "color_histogram"),
        90.0,
        (1.0, 0.0),
        1.0,
        # The preset's, with any method.
        0.6,
    ]


def test_an_empty_target_box_cancels_the_one_before(graph, client, images, box):
    graph.tracker(client, **QUICK)
    client.set_parameters(target_box=[int(value) for value in box])
    client.set_parameters(target_box=Parameter("target_box", Parameter.Type.DOUBLE_ARRAY, []))
    assert client.show(images[0], client.at(0)).values["frame"] == "waiting"
    client.set_parameters(target_box=[int(value) for value in box])
    assert client.show(images[0], client.at(1)).values["frame"] == "started"


def test_a_request_of_an_unknown_type_does_not_end_the_node(graph, client):
    process = graph.process("-p", "image_reliability:=reliable")
    service = client.create_client(SetParameters, "pf_tracker/set_parameters")
    client.wait_for(service.service_is_ready, "parameter service")
    broken = ParameterMessage(name="particles")
    broken.value.type = 200
    service.call_async(SetParameters.Request(parameters=[broken]))
    assert client.set_parameters(particles=40).successful
    assert process.poll() is None
