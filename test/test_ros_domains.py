"""The choice of a ROS domain in which nobody is."""

import itertools
import os
import socket

import pytest

from pf_tracker_ros.ros_domains import unused_domain


def free_domains(count):
    """Domains, in order, that are free by now."""
    found = []
    while len(found) < count:
        with unused_domain(range(found[-1] + 1 if found else 1, 101)) as domain:
            found.append(domain)
    return found


def test_a_domain_is_reserved_until_its_block_ends():
    one, other = free_domains(2)
    candidates = (one, other)
    with unused_domain(candidates) as first, unused_domain(candidates) as second:
        assert (first, second) == candidates
    with unused_domain(candidates) as again:
        assert again == one


def test_what_a_block_raises_gets_through():
    with pytest.raises(OSError, match="of the block"), unused_domain():
        raise OSError("of the block")


# The RTPS standard: 7400 and 250 for each domain, 10 and 11 for the first participant, two more for
# each other one.
@pytest.mark.parametrize("offset", [0, 10, 11, 12, 201])
def test_a_domain_with_a_participant_is_passed_over(offset):
    one, other = free_domains(2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 7400 + 250 * one + offset))
        with unused_domain((one, other)) as domain:
            assert domain == other


def test_where_every_domain_has_somebody_that_is_told_with_what_to_do():
    with (
        unused_domain() as domain,
        pytest.raises(RuntimeError, match="end what runs"),
        unused_domain([domain]),
    ):
        pass


def test_the_next_test_takes_no_domain_with_a_node_of_somebody_else(
    monkeypatch, request, domain_numbers
):
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with unused_domain(itertools.islice(domain_numbers, 100)) as domain:
        pass
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain)
    try:
        node = rclpy.create_node("left_running", context=context)
        # All others come before that one again.
        for _ in range(99):
            next(domain_numbers)
        taken = request.getfixturevalue("ros_domain")
        assert taken != domain
        assert os.environ["ROS_DOMAIN_ID"] == str(taken)
        node.destroy_node()
    finally:
        context.try_shutdown()
