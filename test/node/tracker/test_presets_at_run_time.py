"""Changes of presets and parameters while a target is tracked."""

from nodes import ids
from rclpy.parameter import Parameter

from pf_tracker_ros.tracking.presets import preset_parameters

RELIABLE = {"image_reliability": "reliable"}
RCLPY_PARAMETERS = {"use_sim_time", "start_type_description_service"}


def set_one_request(client, values):
    """The results of one request to the service `set_parameters`."""
    parameters = [Parameter(name, value=value) for name, value in values.items()]
    return client.call(client.parameters.set_parameters, parameters).results


def test_a_preset_replaces_all_values_and_differences_are_reported(
    graph, client, images, box, capfd
):
    graph.tracker(client, target_box=box, particles=33, **RELIABLE)
    client.set_parameters(motion__position_noise=0.9)
    assert client.show(images[2], client.at(2)).values["preset"] == "default, 2 values changed"
    assert client.set_parameters(preset="li2007", particles=44).successful
    assert client.tunables() == preset_parameters("li2007") | {"particles": 44}
    status = client.show(images[4], client.at(4))
    assert status.values["preset"] == "li2007, 1 value changed"
    # The target is kept.
    assert (status.values["frame"], status.values["state"]) == ("tracked", "tracking")
    log = capfd.readouterr().err
    assert "preset li2007, 1 value changed: particles 44 instead of 60\n" in log


def test_a_request_is_applied_as_a_whole_in_any_order(graph, client):
    graph.tracker(client, **RELIABLE)
    # One by one, the first would be refused, and the last would reset the others.
    given = {"proposal.share": 0.4, "particles": 31, "preset": "zhang_bo"}
    assert all(result.successful for result in set_one_request(client, given))
    expected = preset_parameters("zhang_bo") | {"proposal.share": 0.4, "particles": 31}
    assert client.tunables() == expected


def test_all_values_of_a_node_can_be_set_again(graph, client):
    node = graph.tracker(client, preset="zhang_bo", particles=31, **RELIABLE)
    names = node.list_parameters([], 0).names
    before = node.get_parameters(names)
    assert client.set_parameters(preset="li2007", click_size=7.0).successful
    results = client.call(client.parameters.set_parameters, before).results
    assert [result.reason for result in results] == [""] * len(names)
    assert [parameter.value for parameter in node.get_parameters(names)] == [
        parameter.value for parameter in before
    ]
    assert client.set_parameters(particles=30).successful


def test_the_valid_part_of_a_request_is_applied(graph, client):
    graph.tracker(client, **RELIABLE)
    given = {"particles": 31, "imaginary": 1, "click_size": -1.0, "preset": "li2007"}
    results = set_one_request(client, given)
    assert [result.successful for result in results] == [True, False, False, True]
    assert client.tunables() == preset_parameters("li2007") | {"particles": 31}


def on_node(node):
    """Name to type and value of the parameters of a node."""
    names = [name for name in node.list_parameters([], 0).names if name not in RCLPY_PARAMETERS]
    parameters = node.get_parameters(names)
    return {one.name: (one.type_.name, str(one.get_parameter_value())) for one in parameters}


REFUSED = [
    ({"cues": ["hog"]}, "no cue in 'cues' can search"),
    (
        {"preset": "zhang2015", "hog__sharpness": -1.0},
        "parameter 'hog.sharpness' is -1.0; allowed: float, 0 to 1000",
    ),
    ({"zzz": 9}, "no parameter 'zzz' (see `ros2 param list` or docs/parameters.md)"),
]


def test_a_refused_request_changes_nothing_and_has_its_reason(graph, client, images, box):
    node = graph.tracker(client, target_box=box, **RELIABLE)
    client.show(images[0], client.at(0))
    before = on_node(node)
    for index, (request, reason) in enumerate(REFUSED, start=1):
        result = client.set_parameters(**request)
        assert not result.successful
        assert reason in result.reason
        assert on_node(node) == before
        status = client.show(images[index], client.at(index))
        assert (status.level, status.values["frame"]) == ("WARN", "tracked")
        assert reason in status.message
        assert status.values["preset"] == "default"
        # The service `set_parameters` has the reason, too.
        names = {name.replace("__", "."): value for name, value in request.items()}
        assert reason in set_one_request(client, names)[-1].reason
        assert client.set_parameters(preset="default").successful


def test_another_number_of_targets_keeps_the_target_and_its_selection(graph, client, walkers):
    images, boxes = walkers
    graph.tracker(client, target_box=list(boxes[0][0]), **RELIABLE)
    client.show(images[0], client.at(0))
    assert client.set_parameters(max_targets=3).successful
    assert client.tunables() == preset_parameters("default", 3)
    client.point_at(boxes[1][1])
    status = client.show(images[1], client.at(1))
    assert (status.values["frame"], ids(status)) == ("started", [1, 2])
    assert (status.values["selected"], status.values["preset"]) == ("1", "default")
    client.box_at(client.at(1))
    more = {"target_box": [0.0, 0.0, 30.0, 30.0], "max_targets": 2}
    assert client.set_parameters(**more).successful
    status = client.show(images[2], client.at(2))
    assert "target refused: there are 2 targets" in status.message


def test_values_set_with_another_number_of_targets_are_kept(graph, client, capfd):
    graph.tracker(client, **RELIABLE)
    given = {"particles": 31, "detector.labels": ["dog"], "max_targets": 4}
    assert all(result.successful for result in set_one_request(client, given))
    expected = preset_parameters("default", 4) | {"particles": 31, "detector.labels": ("dog",)}
    assert client.tunables() == expected
    assert "preset default, 2 values changed: particles 31 instead of 100" in capfd.readouterr().err
    assert client.set_parameters(max_targets=2).successful
    assert client.tunables() == expected | {"max_targets": 2}
    # The parameters that describe the detector are not reset.
    assert client.set_parameters(max_targets=1).successful
    assert client.tunables() == preset_parameters("default") | {"detector.labels": ("dog",)}
