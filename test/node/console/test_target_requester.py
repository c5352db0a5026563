"""The console's requests to a tracker, and their responses."""

import time

import pytest
from console_pages import run_apart
from std_srvs.srv import Trigger

from pf_tracker_ros.node.console import tracker_services
from pf_tracker_ros.node.console.target_requester import (
    TargetRequester,
    response_from_diagnostics,
    response_from_status,
)
from pf_tracker_ros.node.console.tracker_services import TrackerError, TrackerServices


def status(message="tracking", **values):
    return {"level": "ok", "message": message, "values": values}


def test_a_frame_that_started_a_target_accepts_it():
    assert response_from_status(status(frame="tracked")) is None
    assert response_from_status(status(frame="started")).outcome == "accepted"


def test_a_refusal_has_the_nodes_own_reason():
    response = response_from_status(status("not so; target refused: it is small; allowed: any"))
    assert response.outcome == "refused"
    assert response.text == "target refused: it is small; allowed: any"


def test_without_images_the_diagnostics_have_the_response():
    error = status(last_error="target refused: no area", seconds_since_error=0.5)
    response = response_from_diagnostics(error, sent_for=1.0)
    assert (response.outcome, response.text) == ("refused", "target refused: no area")


def test_an_earlier_or_other_error_is_no_response():
    error = status(last_error="target refused: no area", seconds_since_error=2.0)
    assert response_from_diagnostics(error, sent_for=1.0) is None
    other = status(last_error="an image was refused", seconds_since_error=0.1)
    assert response_from_diagnostics(other, sent_for=1.0) is None
    assert response_from_diagnostics(status(last_error=""), sent_for=1.0) is None


class Link:
    has_target_subscribers = True


def sent(requester, send):
    """Send by a requester, and return the time."""
    run_apart(requester.send(send))
    return time.monotonic()


def test_a_target_is_resent_after_statuses_without_a_response():
    times = []
    requester = TargetRequester(Link(), lambda response: None)
    now = sent(requester, lambda: times.append("sent"))
    for last_status_at in (now - 1.0, now, now + 0.4):
        requester.poll(last_status_at, now + 10.0, may_resend=True)
    requester.poll(now + 0.6, now + 10.0, may_resend=False)
    assert len(times) == 1
    requester.poll(now + 0.6, now + 0.6, may_resend=True)
    requester.poll(now + 0.7, now + 0.7, may_resend=True)
    assert len(times) == 2
    for second in range(1, 60):
        requester.poll(now + second, now + second, may_resend=True)
    assert len(times) == 4


def test_a_target_that_waits_for_a_paused_recording_says_how_to_continue():
    responses = []
    requester = TargetRequester(Link(), responses.append)
    now = sent(requester, lambda: None)
    requester.poll(0.0, now, may_resend=False, recording_paused=True)
    assert responses == []
    requester.poll(0.0, now + 2.0, may_resend=False, recording_paused=True)
    assert [one.text for one in responses] == [
        "sent; the tracker starts it on the next image: go one frame on, or play"
    ]


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
