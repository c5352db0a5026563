"""The topics `~/likelihood` and `~/target_probability`, published only with a subscriber."""

import numpy as np
from nodes import corners
from sensor_msgs.msg import Image


def test_it_is_around_the_box_and_published_only_with_a_subscriber(graph, client, images, box):
    node = graph.tracker(client, target_box=box)
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/likelihood")]
    statuses = client.show_all(images[:3])
    assert not any("likelihood_x" in status.values for status in statuses)

    received = []
    subscription = client.create_subscription(Image, "pf_tracker/likelihood", received.append, 10)
    client.wait_for(
        lambda: publisher.get_subscription_count() and subscription.get_publisher_count(),
        "connection",
    )
    status = client.show(images[3], client.at(3))
    message = client.answer(received, client.at(3))
    assert (message.encoding, message.width, message.height) == ("32FC1", 32, 32)
    values = np.frombuffer(message.data, np.float32).reshape(32, 32)
    row, column = np.unravel_index(np.argmax(values), values.shape)
    x, y, side = (float(status.values[f"likelihood_{name}"]) for name in ("x", "y", "side"))
    center = np.mean(corners(client.box_at(client.at(3))), axis=0)
    peak = np.array([x + (column + 0.5) * side / 32, y + (row + 0.5) * side / 32])
    assert np.abs(peak - center).max() < 6.0
    for cue in ("color_contrast", "correlation_response"):
        at_target, at_second_peak = (
            float(status.values[f"at_{k}_{cue}"]) for k in ("target", "second_peak")
        )
        assert at_second_peak < at_target <= 0.0

    client.destroy_subscription(subscription)
    client.wait_for(lambda: not publisher.get_subscription_count(), "end of the subscription")
    assert "likelihood_x" not in client.show(images[4], client.at(4)).values


def test_the_colors_of_the_target_are_told_from_its_surroundings(graph, client, images, box):
    received = client.collect(Image, "pf_tracker/target_probability")
    node = graph.tracker(client, target_box=box, preset="li2007", particles=50)
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/target_probability")]
    client.wait_for(publisher.get_subscription_count, "connection")
    client.show_all(images[:3])
    message = client.answer(received, client.at(2))
    assert message.encoding == "mono8"
    probability = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
    assert probability[message.height // 4 : -message.height // 4].mean() > 0.7 * 255
