"""Reservation of an unused ROS domain."""

import itertools
import os
import socket

import pytest

from pf_tracker_ros.ros_domains import unused_domain


def free_domains(count):
    """The first free domains."""
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


# The RTPS standard: 7400 and 250 for each domain, 10 and 11 for the first participant, two more for
# each other one.
@pytest.mark.parametrize("offset", [0, 10, 11, 12, 201])
def test_a_domain_with_a_participant_is_skipped(offset):
    one, other = free_domains(2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 7400 + 250 * one + offset))
        with unused_domain((one, other)) as domain:
            assert domain == other


def test_no_free_domain_is_an_error_and_an_error_in_the_block_propagates():
    with (
        unused_domain() as domain,
        pytest.raises(RuntimeError, match="end the nodes of one domain"),
        unused_domain([domain]),
    ):
        pass
    with pytest.raises(OSError, match="of the block"), unused_domain():
        raise OSError("of the block")


def test_the_fixture_skips_a_domain_with_a_foreign_node(monkeypatch, request, domain_numbers):
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
