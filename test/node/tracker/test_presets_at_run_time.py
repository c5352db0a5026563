"""Changes of presets and parameters while a target is tracked."""

import pytest
from rclpy.parameter import Parameter

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import SELF_CONTAINED, preset_parameters

RELIABLE = {"image_reliability": "reliable"}
RCLPY_PARAMETERS = {"use_sim_time", "start_type_description_service"}


@pytest.fixture
def boxes(moving_square):
    return [[float(value) for value in box] for box in moving_square.boxes]


def set_one_request(client, values):
    """The results of one request to the service `set_parameters`."""
    parameters = [Parameter(name, value=value) for name, value in values.items()]
    return client.call(client.parameters.set_parameters, parameters).results


def corner(message):
    return message.polygon.points[0].x, message.polygon.points[0].y


def test_every_change_of_the_preset_keeps_the_target(graph, client, images, boxes):
    graph.tracker(client, seed=1, **RELIABLE)
    for before in SELF_CONTAINED:
        for after in SELF_CONTAINED:
            assert client.set_parameters(preset=before, target_box=boxes[0]).successful
            client.show_all(images[:6])
            assert client.set_parameters(preset=after).successful
            assert client.tunables() == preset_parameters(after)
            client.boxes.clear()
            for index in range(6, 10):
                status = client.show(images[index], client.at(index))
                assert status.values["frame"] == "tracked", (before, after)
                assert status.values["state"] == "tracking", (before, after)
                assert status.values["preset"] == after
            found = corner(client.box_at(client.at(9)))
            assert found == pytest.approx(boxes[9][:2], abs=9), (before, after)


def test_a_preset_replaces_all_values_and_differences_are_reported(
    graph, client, images, boxes, capfd
):
    graph.tracker(client, target_box=boxes[0], particles=33, **RELIABLE)
    client.set_parameters(motion__position_noise=0.9)
    client.show_all(images[:2])
    assert client.show(images[2], client.at(2)).values["preset"] == "default, 2 values changed"
    for preset in ("zhang2015", "default"):
        assert client.set_parameters(preset=preset).successful
        assert client.tunables() == preset_parameters(preset)
    status = client.show(images[3], client.at(3))
    assert (status.values["preset"], status.values["particles"]) == ("default", "200")
    assert client.set_parameters(preset="li2007", particles=44).successful
    assert client.tunables() == preset_parameters("li2007") | {"particles": 44}
    status = client.show(images[4], client.at(4))
    assert status.values["preset"] == "li2007, 1 value changed"
    assert client.set_parameters(motion__position_noise=0.25).successful
    assert client.show(images[5], client.at(5)).values["preset"] == "li2007, 2 values changed"
    log = capfd.readouterr().err
    assert "preset zhang2015\n" in log
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


@pytest.mark.parametrize("preset", SELF_CONTAINED)
def test_every_tunable_of_the_library_can_change_while_tracking(
    graph, client, images, preset, other_values
):
    box = [20.0, 30.0, 24.0, 24.0]
    graph.tracker(client, target_box=box, preset=preset, **RELIABLE)
    client.show(images[0], client.at(0))
    known = declarations(TrackerParameters)
    before = client.tunables()
    assert before.keys() == known.keys()
    refused = set()
    for name, declaration in known.items():
        other = other_values(declaration, before[name])[0]
        result = client.set_parameters(**{name: other})
        if result.successful:
            assert client.get_parameters(name) == [other]
            assert client.set_parameters(**{name: before[name]}).successful
        else:
            assert "allowed" in result.reason, (name, result.reason)
            refused.add(name)
        assert client.tunables() == before
    # Parameters that depend on each other can only change together.
    assert refused <= {"motion.model", "proposal.method", "cues", "appearance.kind"}
    assert client.show(images[1], client.at(1)).values["frame"] == "tracked"


CONTRADICTION = {"proposal__method": "kalman", "motion__model": "constant_velocity"}
REASON = "parameter 'proposal.method' is 'kalman' with the motion model 'constant_velocity'"


def test_contradictory_values_are_refused_at_run_time(graph, client, images, boxes):
    graph.tracker(client, target_box=boxes[0], **RELIABLE)
    client.show(images[0], client.at(0))
    before = client.tunables()
    result = client.set_parameters(**CONTRADICTION)
    assert not result.successful
    assert REASON in result.reason
    assert client.tunables() == before
    status = client.show(images[1], client.at(1))
    assert (status.level, status.values["frame"]) == ("WARN", "tracked")
    assert REASON in status.message


def test_contradictory_values_at_start_up_keep_the_node_idle_until_corrected(
    graph, client, images, boxes
):
    graph.tracker(client, target_box=boxes[0], **CONTRADICTION, **RELIABLE)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["state"]) == ("ERROR", "idle")
    assert REASON in status.message
    assert client.set_parameters(motion__model="affine").successful
    assert client.show(images[0], client.at(1)).values["frame"] == "started"


def test_a_set_of_many_parameters_is_all_or_nothing(graph, client, images, boxes):
    graph.tracker(client, target_box=boxes[0], **RELIABLE)
    client.show(images[0], client.at(0))
    names = ["preset", "particles", "motion.model", "time_jump", "click_size"]
    before = client.get_parameters(*names)
    invalid = {
        "preset": "zhang2015",
        "particles": 77,
        "motion__model": "affine",
        "time_jump": "wait",
        "click_size": -1.0,
    }
    assert not client.set_parameters(**invalid).successful
    assert client.get_parameters(*names) == before
    assert client.set_parameters(**invalid | {"click_size": 9.0}).successful
    assert client.get_parameters(*names) == ["zhang2015", 77, "affine", "wait", 9.0]
    assert client.show(images[1], client.at(1)).values["frame"] == "tracked"


def on_node(node):
    """Name to type and value of the parameters of a node."""
    names = [name for name in node.list_parameters([], 0).names if name not in RCLPY_PARAMETERS]
    parameters = node.get_parameters(names)
    return {one.name: (one.type_.name, str(one.get_parameter_value())) for one in parameters}


def test_a_change_of_the_preset_and_back_restores_all_values(graph, client):
    node = graph.tracker(client, particles=31, **RELIABLE)
    assert client.set_parameters(preset="default").successful
    before = on_node(node)
    for preset in ("zhang2015", "zhang_bo", "li2007"):
        assert client.set_parameters(preset=preset).successful
        assert client.tunables() == preset_parameters(preset)
        assert set(on_node(node)) == set(before)
    assert client.set_parameters(preset="default").successful
    assert on_node(node) == before


def test_one_request_sets_a_preset_and_values_of_its_cues(graph, client):
    graph.tracker(client, **RELIABLE)
    given = {"hog.sharpness": 200.0, "particles": 31, "preset": "zhang2015"}
    assert all(result.successful for result in set_one_request(client, given))
    expected = preset_parameters("zhang2015") | {"hog.sharpness": 200.0, "particles": 31}
    assert client.tunables() == expected
    assert client.set_parameters(preset="li2007", color_histogram__keep=0.5).successful
    assert client.tunables() == preset_parameters("li2007") | {"color_histogram.keep": 0.5}


REFUSED = {
    "a choice that contradicts the others": (
        {"cues": ["hog"]},
        "no cue in 'cues' can search",
    ),
    "no choice": ({"cues": []}, "parameter 'cues' is empty; allowed: at least one of "),
    "an invalid value of a cue of the preset": (
        {"preset": "zhang2015", "hog__sharpness": -1.0},
        "parameter 'hog.sharpness' is -1.0; allowed: float, 0 to 1000",
    ),
    "an invalid value of another cue": (
        {"particles": 9, "hog__sharpness": -1.0},
        "parameter 'hog.sharpness' is -1.0; allowed: float, 0 to 1000",
    ),
    "a misspelt name": ({"particels": 9}, "no parameter 'particels' (did you mean 'particles'?)"),
    "an unknown name": (
        {"zzz": 9},
        "no parameter 'zzz' (see `ros2 param list` or docs/parameters.md)",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_refused_request_changes_nothing_and_has_its_reason(graph, client, images, boxes, kind):
    request, reason = REFUSED[kind]
    node = graph.tracker(client, target_box=boxes[0], **RELIABLE)
    client.show(images[0], client.at(0))
    before = on_node(node)
    result = client.set_parameters(**request)
    assert not result.successful
    assert reason in result.reason
    assert on_node(node) == before
    status = client.show(images[1], client.at(1))
    assert (status.level, status.values["frame"]) == ("WARN", "tracked")
    assert reason in status.message
    assert status.values["preset"] == "default"
    # The service `set_parameters` has the reason, too.
    (*_, last) = set_one_request(
        client, {name.replace("__", "."): one for name, one in request.items()}
    )
    assert reason in last.reason


def test_the_valid_part_of_a_request_may_be_contradictory_one_by_one(graph, client):
    graph.tracker(client, **RELIABLE)
    given = {"hog.sharpness": 90.0, "wings": 2, "cues": ["hog"], "proposal.method": "transition"}
    results = set_one_request(client, given)
    assert [result.successful for result in results] == [True, False, True, True]
    assert client.get_parameters("cues", "hog.sharpness") == [("hog",), 90.0]


def test_all_listed_parameters_are_described(graph, client):
    graph.tracker(client, **RELIABLE)
    names = client.parameter_names()
    described = client.call(client.parameters.describe_parameters, names).descriptors
    assert [one.name for one in described] == names
    known = declarations(TrackerParameters)
    assert sorted(names) == sorted(known | declarations(NodeParameters))
    for descriptor in described:
        if descriptor.name in known:
            assert descriptor.description.startswith(known[descriptor.name].description)
            assert not descriptor.read_only
    (hog,) = (one for one in described if one.name == "hog.keep")
    assert hog.description.endswith(" Used only if 'cues' contains 'hog'.")
