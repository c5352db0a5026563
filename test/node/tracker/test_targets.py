"""Start and end of a target in a live node: stamps, clicks, stop and enable."""

import math

import pytest
from geometry_msgs.msg import Point, PointStamped
from nodes import NEVER_OCCLUDED as QUICK
from std_srvs.srv import SetBool, Trigger


@pytest.fixture
def click(client, send):
    """A function that clicks at a point; the tracker receives it before the next image."""
    return lambda node, x, y: send(
        client, node, "pf_tracker/click", PointStamped(point=Point(x=float(x), y=float(y)))
    )


def corners(message):
    first, _, opposite, _ = message.polygon.points
    return first.x, first.y, opposite.x - first.x, opposite.y - first.y


def test_a_click_starts_on_the_square_around_it(graph, client, images, click):
    node = graph.tracker(client, click_size=20.0, **QUICK)
    click(node, 50, 60)
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
    assert corners(client.box_at(client.at(0))) == (40, 50, 20, 20)
    client.set_parameters(click_size=30.0)
    click(node, 50, 60)
    client.show(images[0], client.at(1))
    assert corners(client.box_at(client.at(1))) == (35, 45, 30, 30)


def test_an_invalid_click_is_refused(graph, client, images, click):
    node = graph.tracker(client, **QUICK)
    clicks = [(math.nan, 5, "not finite"), (1, math.inf, "not finite"), (900, 5, "outside")]
    for index, (x, y, reason) in enumerate(clicks):
        click(node, x, y)
        status = client.show(images[0], client.at(index))
        assert (status.level, status.values["state"]) == ("WARN", "idle")
        assert status.message.startswith("target refused: ")
        assert reason in status.message


def test_services_work_before_the_first_image(graph, client, images, box):
    graph.tracker(client, **QUICK)
    assert client.ask(SetBool, "enable", data=True).success
    assert client.ask(SetBool, "enable", data=False).success
    assert client.ask(Trigger, "stop").success
    client.point_at(box)
    assert client.ask(SetBool, "enable", data=True).success
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
