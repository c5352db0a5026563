"""The node's parameters, at start-up and at run time, over the parameter services."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

QUICK = {"particles": 20, "track__wrong_box_cost": 0.0, "image_reliability": "reliable"}
# Including those of rclpy.
MAX_PARAMETERS = 75
KNOWN = declarations(NodeParameters) | declarations(TrackerParameters)


def get(client, *names):
    response = client.call(client.parameters.get_parameters, list(names))
    return [parameter_value_to_python(value) for value in response.values]


def test_a_node_has_the_parameters_of_all_parts_and_not_too_many(graph, client):
    graph.tracker(client)
    names = client.parameter_names()
    assert sorted(names) == sorted(KNOWN)
    every = client.call(client.parameters.list_parameters).result.names
    assert set(names) < set(every)
    assert len(every) <= MAX_PARAMETERS


def test_every_parameter_is_described_and_every_float_has_a_range(graph, client):
    graph.tracker(client)
    response = client.call(client.parameters.describe_parameters, list(KNOWN))
    assert len(response.descriptors) == len(KNOWN)
    for descriptor in response.descriptors:
        declaration = KNOWN[descriptor.name]
        assert descriptor.description.startswith(declaration.description)
        assert declaration.unit in descriptor.description
        # The node can change what the library fixes while it tracks: it relearns the target.
        assert descriptor.read_only == (descriptor.name == "autostart")
        if descriptor.type == Parameter.Type.DOUBLE.value:
            (limits,) = descriptor.floating_point_range
            assert (limits.from_value, limits.to_value) == (
                declaration.minimum,
                declaration.maximum,
            )
        else:
            constraints = descriptor.additional_constraints
            assert constraints == f"allowed: {declaration.allowed}" or declaration.type is int
    (hog,) = (one for one in response.descriptors if one.name == "hog.keep")
    assert hog.description.endswith(" Used only if 'cues' contains 'hog'.")


REFUSED = {
    "out of range": ("particles", 0, 20, "int, 1 to 100000"),
    "no cue": ("cues", ["smell"], ["color_contrast"], "list of strings, each at most once"),
    "no preset of that name": ("preset", "lee2007", "li2007", "'default' or 'li2007'"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_an_invalid_parameter_keeps_the_node_idle_until_corrected(graph, client, images, kind):
    name, invalid, valid, allowed = REFUSED[kind]
    box = [20.0, 30.0, 24.0, 24.0]
    graph.tracker(client, **{"target_box": box, **QUICK, name: invalid})
    for index in range(2):
        status = client.show(images[0], client.at(index))
        assert (status.level, status.values["state"]) == ("ERROR", "idle")
        for text in (status.message, status.values["last_error"]):
            assert f"parameter '{name.replace('__', '.')}' is {invalid!r}" in text
            assert allowed in text
    client.point_at(box)
    status = client.show(images[0], client.at(2))
    assert "target refused: not tracking" in status.message
    assert not client.boxes

    assert client.set_parameters(**{name: valid}).successful
    status = client.show(images[1], client.at(3))
    assert (status.level, status.values["frame"]) == ("OK", "started")
    client.box_at(client.at(3))


def test_all_invalid_parameters_are_reported_at_once(graph, client, images, box):
    graph.tracker(client, **QUICK | {"particles": -5, "seed": 1.5, "target_box": box})
    message = client.show(images[0], client.at(0)).message
    assert message.startswith("not tracking: ")
    assert message.count("parameter 'particles' is -5") == 1
    assert message.count("parameter 'seed' is 1.5") == 1
    client.set_parameters(seed=1)
    message = client.show(images[0], client.at(1)).message
    assert message.startswith("not tracking: parameter 'particles' is -5")
    assert "'seed'" not in message
    client.set_parameters(particles=5)
    status = client.show(images[0], client.at(2))
    assert (status.level, status.message) == ("OK", "tracking")


def test_a_preset_corrected_at_run_time_sets_all_values(graph, client, images, box, capfd):
    graph.tracker(client, preset="lee2007", target_box=box, **QUICK)
    log = capfd.readouterr().err
    assert "parameter 'preset' is 'lee2007'" in log
    assert "not tracking until the parameters are corrected; images on /image" in log
    assert "preset default" not in log
    assert client.set_parameters(preset="li2007").successful
    status = client.show(images[0], client.at(0))
    assert (status.values["preset"], status.values["particles"]) == ("li2007", "60")
    assert client.tunables() == preset_parameters("li2007")


def test_an_unknown_parameter_is_reported_and_the_node_tracks(graph, client, images, box):
    graph.tracker(client, target_box=box, particels=50, **QUICK)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["frame"]) == ("WARN", "started")
    assert "no parameter 'particels' (did you mean 'particles'?)" in status.message


def test_a_value_of_an_unused_cue_is_kept(graph, client, images, box):
    graph.tracker(client, target_box=box, hog__sharpness=90.0, **QUICK)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["frame"]) == ("OK", "started")
    assert status.values["preset"] == "default, 3 values changed"
    assert client.set_parameters(cues=["correlation_response", "hog"]).successful
    assert get(client, "hog.sharpness") == [90.0]


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


def test_a_long_value_is_cut_in_the_message(graph, client, images):
    graph.tracker(client, **QUICK)
    assert not client.set_parameters(resampling__scheme="x" * 1_000_000).successful
    status = client.show(images[0], client.at(0))
    assert "parameter 'resampling.scheme' is 'xxx" in status.message
    assert len(status.message) < 2000


def test_an_empty_target_box_cancels_the_one_before(graph, client, images, box):
    graph.tracker(client, **QUICK)
    client.set_parameters(target_box=[int(value) for value in box])
    client.set_parameters(target_box=Parameter("target_box", Parameter.Type.DOUBLE_ARRAY, []))
    assert client.show(images[0], client.at(0)).values["frame"] == "waiting"
    client.set_parameters(target_box=[int(value) for value in box])
    assert client.show(images[0], client.at(1)).values["frame"] == "started"


def test_the_reliability_can_change_at_run_time(graph, client, images, box):
    node = graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    client.set_parameters(image_reliability="best_effort")
    (endpoint,) = node.get_subscriptions_info_by_topic("/image")
    assert endpoint.qos_profile.reliability.name == "BEST_EFFORT"
    client.set_parameters(image_reliability="reliable")
    graph.introduce(client, node)
    assert client.show(images[1], client.at(1)).values["frame"] == "tracked"


def test_a_request_of_an_unknown_type_does_not_end_the_node(graph, client):
    process = graph.process("-p", "image_reliability:=reliable")
    service = client.create_client(SetParameters, "pf_tracker/set_parameters")
    client.wait_for(service.service_is_ready, "parameter service")
    broken = ParameterMessage(name="particles")
    broken.value.type = 200
    service.call_async(SetParameters.Request(parameters=[broken]))
    assert client.set_parameters(particles=40).successful
    assert process.poll() is None
