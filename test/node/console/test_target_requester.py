"""What became of a target, read from what the tracker says."""

import asyncio
import threading
import time

from pf_tracker_ros.node.console.target_requester import (
    TargetRequester,
    response_from_diagnostics,
    response_from_status,
)


def status(message="tracking", **values):
    return {"level": "ok", "message": message, "values": values}


def test_a_frame_that_started_a_target_accepts_it():
    assert response_from_status(status(frame="tracked")) is None
    assert response_from_status(status(frame="started")).outcome == "accepted"


def test_the_nodes_own_reason_is_given():
    verdict = response_from_status(status("not so; target refused: it is small; allowed: any"))
    assert verdict.outcome == "refused"
    assert verdict.text == "target refused: it is small; allowed: any"


def test_without_images_the_diagnostics_tell():
    error = status(last_error="target refused: no area", seconds_since_error=0.5)
    verdict = response_from_diagnostics(error, sent_for=1.0)
    assert (verdict.outcome, verdict.text) == ("refused", "target refused: no area")


def test_what_was_refused_before_says_nothing_of_this_one():
    error = status(last_error="target refused: no area", seconds_since_error=2.0)
    assert response_from_diagnostics(error, sent_for=1.0) is None
    other = status(last_error="an image was refused", seconds_since_error=0.1)
    assert response_from_diagnostics(other, sent_for=1.0) is None
    assert response_from_diagnostics(status(last_error=""), sent_for=1.0) is None


class Link:
    has_target_subscribers = True


def sent(picker, send):
    """Send by a picker, and tell when."""
    # In a thread: the browser tests keep an event loop in this one.
    thread = threading.Thread(target=lambda: asyncio.run(picker.send(send)))
    thread.start()
    thread.join()
    return time.monotonic()


def test_it_is_sent_again_where_frames_are_answered_that_do_not_tell_of_it():
    times = []
    picker = TargetRequester(Link(), lambda verdict: None)
    now = sent(picker, lambda: times.append("sent"))
    for last_status_at in (now - 1.0, now, now + 0.4):
        picker.poll(last_status_at, now + 10.0, may_resend=True)
    picker.poll(now + 0.6, now + 10.0, may_resend=False)
    assert len(times) == 1
    picker.poll(now + 0.6, now + 0.6, may_resend=True)
    picker.poll(now + 0.7, now + 0.7, may_resend=True)
    assert len(times) == 2
    for second in range(1, 60):
        picker.poll(now + second, now + second, may_resend=True)
    assert len(times) == 4


def test_what_waits_for_a_recording_that_stands_still_says_how_it_goes_on():
    told = []
    picker = TargetRequester(Link(), told.append)
    now = sent(picker, lambda: None)
    picker.poll(0.0, now, may_resend=False, recording_paused=True)
    assert told == []
    picker.poll(0.0, now + 2.0, may_resend=False, recording_paused=True)
    assert [one.text for one in told] == [
        "sent; the tracker answers with the next image: press N for it, or play"
    ]
