"""The bridge with stand-ins for browser and link, without a ROS graph."""

import asyncio
import json

import numpy as np
import pytest
from console_pages import run_apart

from pf_tracker_ros.node.console import bridge as module
from pf_tracker_ros.node.console.bridge import ConsoleBridge
from pf_tracker_ros.node.console.image_encoding import EncodedImage


class Link:
    """Records what is sent."""

    name = "/pf_tracker"
    has_target_subscribers = True
    graph_faults = ()

    def __init__(self):
        self.sent, self.watched = [], []

    def watch(self, watched):
        self.watched.append(watched)

    def watch_likelihood(self, watched):
        self.likelihood = watched

    def available_trackers(self):
        return []

    def set_image_topic(self, topic):
        self.sent.append(("image_topic", topic))

    def send_target(self, box, stamp):
        self.sent.append(("target", box, stamp))

    def send_click(self, x, y, stamp):
        self.sent.append(("click", x, y, stamp))


class Browser:
    """Counts what is received."""

    is_local = False

    def __init__(self):
        self.messages, self.frames = [], 0

    async def send_json(self, message):
        self.messages.append(message)

    async def send_bytes(self, message):
        self.frames += 1


@pytest.fixture
def image(image_message):
    """The message of a gray image of one pixel."""
    return image_message(np.array([[7]], np.uint8), encoding="mono8")


@pytest.fixture
def run():
    """A function that runs a coroutine function with a bridge, its link and a browser."""

    async def play(scenario):
        link, browser = Link(), Browser()
        bridge = ConsoleBridge(link)
        try:
            return await scenario(bridge, link, browser)
        finally:
            bridge.close()

    return lambda scenario: run_apart(play(scenario))


@pytest.mark.parametrize(
    "message",
    [
        None,
        "stop",
        {"type": "unknown"},
        {"type": ["stop"]},
        {"type": [float("inf")]},
        {"a": float("nan")},
        {"type": "target"},
        {"type": "target", "box": [1, 2, 3], "stamp": "1"},
        {"type": "target", "box": [1, 2, 3, "4"], "stamp": "1"},
        {"type": "target", "box": [1, 2, 3, True], "stamp": "1"},
        {"type": "target", "box": [1, 2, 3, float("nan")], "stamp": "1"},
        {"type": "target", "box": [1, 2, 3, 1e300], "stamp": "1"},
        {"type": "target", "box": [1, 2, 3, 4]},
        {"type": "target", "box": [1, 2, 3, 4], "stamp": 1},
        {"type": "target", "box": [1, 2, 3, 4], "stamp": "-1"},
        {"type": "target", "box": [1, 2, 3, 4], "stamp": "²"},
        {"type": "target", "box": [1, 2, 3, 4], "stamp": "9" * 19},
        {"type": "click", "point": "here", "stamp": "1"},
        {"type": "enable", "enabled": "yes"},
    ],
)
def test_an_invalid_request_is_refused_with_a_note(run, message):
    async def scenario(bridge, link, browser):
        await bridge.handle(browser, message)
        return link.sent, browser.messages

    sent, (note,) = run(scenario)
    assert sent == []
    assert note["ok"] is False
    assert note["text"]
    # As the connection sends it.
    assert json.dumps(note, allow_nan=False)


@pytest.mark.parametrize("kind", ["target", "click"])
def test_a_target_for_a_silent_tracker_is_not_sent(run, monkeypatch, kind):
    clock = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    message = {"type": kind, "box": [1, 2, 3, 4], "point": [1, 2], "stamp": "5"}

    async def scenario(bridge, link, browser):
        bridge.receive("health", 0, {"level": "ok", "message": "", "values": {}})
        await bridge._poll()
        await bridge.handle(browser, message)
        link.sent.clear()
        clock[0] += 3.0
        await bridge._poll()
        await bridge.handle(browser, message)
        return link.sent, browser.messages

    sent, (note,) = run(scenario)
    assert sent == []
    assert "nothing was sent: the tracker is silent" in note["text"]


def test_a_stamp_keeps_all_its_digits(run):
    async def scenario(bridge, link, browser):
        await bridge.handle(
            browser, {"type": "target", "box": [1, 2, 3, 4], "stamp": "1700000000123456789"}
        )
        return link.sent

    assert run(scenario) == [("target", (1.0, 2.0, 3.0, 4.0), 1_700_000_000_123_456_789)]


def test_a_browser_that_draws_nothing_gets_two_frames_and_then_the_newest(run, image):
    async def scenario(bridge, link, browser):
        welcome = asyncio.ensure_future(bridge.welcome(browser))
        counts = []
        for stamp in range(1, 30):
            bridge.receive("image", stamp, image)
            while not bridge._synchronizer.latest or bridge._synchronizer.latest.number < stamp:
                await asyncio.sleep(0)
            if stamp < 3:
                while browser.frames < stamp:
                    await asyncio.sleep(0)
            counts.append(browser.frames)
        await bridge.handle(browser, {"type": "frame_ack"})
        while browser.frames < 3:
            await asyncio.sleep(0)
        welcome.cancel()
        return counts

    assert run(scenario)[2:] == [2] * 27


def test_a_frame_is_encoded_once_for_all_browsers(run, image, monkeypatch):
    encoded = []

    def encode(message, level):
        encoded.append(level)
        return EncodedImage(1, 1, b"jpeg")

    monkeypatch.setattr("pf_tracker_ros.node.console.browsers.encode_image", encode)

    async def scenario(bridge, link, browser):
        others = [Browser(), Browser()]
        welcomes = [asyncio.ensure_future(bridge.welcome(one)) for one in (browser, *others)]
        await asyncio.sleep(0)
        bridge.receive("image", 1, image)
        while not all(one.frames for one in (browser, *others)):
            await asyncio.sleep(0)
        for welcome in welcomes:
            welcome.cancel()
        return True

    assert run(scenario)
    assert len(encoded) == 1
