"""The topic `~/likelihood`: there only for those who listen."""

import numpy as np
from sensor_msgs.msg import Image


def test_it_comes_around_the_box_and_only_while_somebody_listens(graph, client, images, box):
    node = graph.tracker(client, target_box=box)
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/likelihood")]
    statuses = client.show_all(images[:3])
    assert not any("likelihood_x" in status.values for status in statuses)

    heard = []
    listener = client.create_subscription(Image, "pf_tracker/likelihood", heard.append, 10)
    client.wait_for(
        lambda: publisher.get_subscription_count() and listener.get_publisher_count(), "listener"
    )
    status = client.show(images[3], client.at(3))
    message = client.answer(heard, client.at(3))
    assert (message.encoding, message.width, message.height) == ("32FC1", 32, 32)
    values = np.frombuffer(message.data, np.float32).reshape(32, 32)
    row, column = np.unravel_index(np.argmax(values), values.shape)
    x, y, side = (float(status.values[f"likelihood_{name}"]) for name in ("x", "y", "side"))
    corners = [(point.x, point.y) for point in client.box_at(client.at(3)).polygon.points]
    center = np.mean(corners, axis=0)
    peak = np.array([x + (column + 0.5) * side / 32, y + (row + 0.5) * side / 32])
    assert np.abs(peak - center).max() < 6.0
    for cue in ("color_contrast", "correlation_response"):
        at_target, at_second_peak = (
            float(status.values[f"at_{k}_{cue}"]) for k in ("target", "second_peak")
        )
        assert at_second_peak < at_target <= 0.0

    client.destroy_subscription(listener)
    client.wait_for(lambda: not publisher.get_subscription_count(), "silence")
    assert "likelihood_x" not in client.show(images[4], client.at(4)).values


def test_without_a_target_there_is_nothing_to_hear(graph, client, images):
    heard = []
    client.create_subscription(Image, "pf_tracker/likelihood", heard.append, 10)
    node = graph.tracker()
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/likelihood")]
    client.wait_for(publisher.get_subscription_count, "listener")
    client.meet()
    status = client.show(images[0], client.at(0))
    assert status.values["state"] == "idle"
    assert heard == []
