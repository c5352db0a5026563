"""The console's requests to a tracker."""

import pytest
from console_pages import run_apart
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
    for _ in range(3):
        with pytest.raises(TrackerError, match="/hangs/stop does not respond"):
            run_apart(services.stop())
    assert not services._stop._pending_requests
