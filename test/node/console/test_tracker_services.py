"""The console's requests to a tracker."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import pytest
from std_srvs.srv import Trigger

from pf_tracker_ros.node.console import tracker_services
from pf_tracker_ros.node.console.tracker_services import TrackerError, TrackerServices


def test_a_request_without_a_response_in_time_is_given_up(client, monkeypatch):
    """A hanging tracker: its service exists, and nothing reads the requests."""
    server = client.create_service(Trigger, "/hangs/stop", lambda request, response: response)
    services = TrackerServices(client, "/hangs", lambda action: action())
    client.wait_for(services._stop.service_is_ready, "the service")
    client.destroy_service(server)
    monkeypatch.setattr(services._stop, "service_is_ready", lambda: True)
    monkeypatch.setattr(tracker_services, "_TIMEOUT", 0.05)
    # In a thread, since the tests with a browser leave an event loop running in this one.
    with ThreadPoolExecutor(1) as executor:
        for _ in range(3):
            response = executor.submit(lambda: asyncio.run(services.stop()))
            with pytest.raises(TrackerError, match="/hangs/stop does not respond"):
                response.result()
    assert not services._stop._pending_requests
