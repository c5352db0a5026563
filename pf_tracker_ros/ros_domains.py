"""Reserves a ROS domain that is unused on this machine, for replays and tests; needs no ROS."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

# Port base and domain gain of the RTPS standard: the UDP ports of a domain's participants.
_FIRST_PORT, _PORTS = 7400, 250
# Base of the TCP ports, one for each domain, by which ROS' domain_coordinator reserves a domain.
_RESERVATIONS = 32768
_DOMAINS = range(1, 101)


@contextmanager
def unused_domain(candidates: Iterable[int] = _DOMAINS) -> Iterator[int]:
    """Reserve a ROS domain without participants on this machine until the block ends.

    Args:
        candidates: Domain ids, 1 to 100; the first free one is reserved.

    Raises:
        RuntimeError: None of them is free.
    """
    for domain in candidates:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as reservation:
            if _bind(reservation, _RESERVATIONS + domain) and not _has_participants(domain):
                yield domain
                return
    raise RuntimeError("every ROS domain has a node on this machine; end the nodes of one domain")


def _has_participants(domain: int) -> bool:
    first = _FIRST_PORT + _PORTS * domain
    for port in range(first, first + _PORTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            if not _bind(probe, port):
                return True
    return False


def _bind(one: socket.socket, port: int) -> bool:
    """Bind a port; returns whether it was free."""
    try:
        one.bind(("", port))
    except OSError:
        return False
    return True
