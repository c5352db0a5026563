"""What became of a target, read from what the tracker says."""

import asyncio
import threading
import time

from pf_tracker_ros.node.console.pick import Pick, Picker


def make(sent_at, send=lambda: None):
    return Pick(sent_at, send)


def status(message="tracking", **values):
    return {"level": "ok", "message": message, "values": values}


def test_a_frame_that_started_a_target_accepts_it():
    pick = make(0.0)
    assert pick.judge_status(status(frame="tracked")) is None
    assert pick.judge_status(status(frame="started")).outcome == "accepted"


def test_the_nodes_own_reason_is_given():
    verdict = make(0.0).judge_status(status("not so; target refused: it is small; allowed: any"))
    assert verdict.outcome == "refused"
    assert verdict.text == "target refused: it is small; allowed: any"


def test_without_images_the_diagnostics_tell():
    error = status(last_error="target refused: no area", seconds_since_error=0.5)
    verdict = make(10.0).judge_health(error, now=11.0)
    assert (verdict.outcome, verdict.text) == ("refused", "target refused: no area")


def test_what_was_refused_before_says_nothing_of_this_one():
    error = status(last_error="target refused: no area", seconds_since_error=2.0)
    assert make(10.0).judge_health(error, now=11.0) is None
    other = status(last_error="an image was refused", seconds_since_error=0.1)
    assert make(10.0).judge_health(other, now=11.0) is None
    assert make(10.0).judge_health(status(last_error=""), now=11.0) is None


def test_it_is_sent_again_where_frames_are_answered_that_do_not_tell_of_it():
    sent = []
    pick = make(10.0, lambda: sent.append("again"))
    for answered_at in (9.0, 10.0, 10.4):
        pick.send_again(answered_at, now=20.0)
    assert sent == []
    pick.send_again(10.6, now=10.6)
    pick.send_again(10.7, now=10.7)
    assert sent == ["again"]
    for second in range(11, 60):
        pick.send_again(second, now=second)
    assert len(sent) == 3


def test_what_waits_for_a_recording_that_stands_still_says_how_it_goes_on():
    class Link:
        takes_targets = True

    told = []
    picker = Picker(Link(), told.append)
    # In a thread: the browser tests keep an event loop in this one.
    thread = threading.Thread(target=lambda: asyncio.run(picker.send(lambda: None)))
    thread.start()
    thread.join()
    now = time.monotonic()
    picker.look(0.0, now, may_repeat=False, stands_still=True)
    assert told == []
    picker.look(0.0, now + 2.0, may_repeat=False, stands_still=True)
    assert [one.text for one in told] == [
        "sent; the tracker answers with the next image: press N for it, or play"
    ]
