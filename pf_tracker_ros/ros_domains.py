"""A ROS domain in which nobody on this machine is, for replays and tests; needs no ROS."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

# Of the RTPS standard: each participant of a domain has UDP ports of its own among these.
_FIRST_PORT, _PORTS = 7400, 250
# A TCP port for each domain, as ROS' package domain_coordinator has it: who has it, the domain is
# reserved for.
_RESERVATIONS = 32768
_DOMAINS = range(1, 101)


@contextmanager
def unused_domain(candidates: Iterable[int] = _DOMAINS) -> Iterator[int]:
    """Reserve a ROS domain that has no participant on this machine, for the time of a block.

    It stays reserved, against others who reserve theirs so, until the block ends.

    Args:
        candidates: Numbers of domains, 1 to 100; the first that is free is taken.

    Raises:
        RuntimeError: None of them is free.
    """
    for domain in candidates:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as reservation:
            if _bind(reservation, _RESERVATIONS + domain) and not _has_participants(domain):
                yield domain
                return
    raise RuntimeError(
        "there is no ROS domain without a node on this machine: end what runs in one of them"
    )


def _has_participants(domain: int) -> bool:
    first = _FIRST_PORT + _PORTS * domain
    for port in range(first, first + _PORTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            if not _bind(probe, port):
                return True
    return False


def _bind(one: socket.socket, port: int) -> bool:
    """Take a port; whether nobody else has it."""
    try:
        one.bind(("", port))
    except OSError:
        return False
    return True
