"""What a browser gets, and in which detail."""

import asyncio
import json
import struct
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")

from pf_tracker_ros.node.console import browsers as module
from pf_tracker_ros.node.console.browsers import Browsers
from pf_tracker_ros.node.console.pace import Pace
from pf_tracker_ros.node.console.pairing import Shown
from pf_tracker_ros.node.console.pictures import DETAILS

SLOW = DETAILS[3]
SECOND = 10**9
# So long that no test waits for the end of one.
INTERVAL = 1000 * SECOND
NOW = 5000 * SECOND


class Page:
    """Draws each frame at once.

    Attributes:
        is_here: Whether it is on this machine.
        qualities: Stamp and quality of each frame that came.
    """

    def __init__(self, browsers, is_here=True):
        self._browsers = browsers
        self.is_here = is_here
        self.qualities = []
        self.came = asyncio.Event()

    async def send_json(self, message):
        pass

    async def send_bytes(self, message):
        (length,) = struct.unpack(">I", message[:4])
        header = json.loads(message[4 : 4 + length])
        self.qualities.append((int(header["stamp"]), header["quality"]))
        self._browsers.acknowledge(self)
        self.came.set()

    async def wait_for(self, count):
        while len(self.qualities) < count:
            self.came.clear()
            await asyncio.wait_for(self.came.wait(), 60.0)


def run(scenario):
    """What a coroutine function returns, called in a thread with a loop of its own.

    The tests with a real browser keep an event loop in this one.
    """
    with ThreadPoolExecutor(1) as executor:
        return executor.submit(asyncio.run, scenario()).result()


def drawn(image, counts):
    """Stamp and quality of what a page draws.

    Args:
        image: Of each frame that is shown.
        counts: How many the page is to have drawn before the next frame is shown, a frame each.
    """

    async def play():
        shown = None
        browsers = Browsers(lambda: shown)
        page = Page(browsers)
        browsers.add(page)
        task = asyncio.ensure_future(browsers.show(page, []))
        for number, count in enumerate(counts, 1):
            shown = Shown(number, number, image, {})
            await browsers.show_newest()
            await page.wait_for(count)
        task.cancel()
        browsers.close()
        return page.qualities

    return run(play)


def drawn_before_the_third(image, stamps):
    """How many frames a page here and one elsewhere have, after the first and after the second.

    Args:
        image: Of each frame.
        stamps: Of three frames; with the third, the page here has to get the second in any case.
    """

    async def play():
        shown = None
        browsers = Browsers(lambda: shown)
        here, elsewhere = (Page(browsers, is_here) for is_here in (True, False))
        tasks = []
        for page in (here, elsewhere):
            browsers.add(page)
            tasks.append(asyncio.ensure_future(browsers.show(page, [])))
        counts = []
        for number, stamp in enumerate(stamps, 1):
            shown = Shown(number, stamp, image, {})
            await browsers.show_newest()
            await elsewhere.wait_for(number)
            counts.append((len(here.qualities), len(elsewhere.qualities)))
        await here.wait_for(2)
        for task in tasks:
            task.cancel()
        browsers.close()
        return counts[:2]

    return run(play)


@pytest.fixture
def image(client):
    """A message."""
    return client.message(np.zeros((48, 64, 3), np.uint8))


def test_a_picture_that_stands_still_becomes_sharp_once(image, monkeypatch):
    monkeypatch.setattr(Pace, "detail", SLOW)
    monkeypatch.setattr(module, "_STANDS_STILL", 0.05)
    qualities = (SLOW.quality, DETAILS[0].quality)
    expected = [(number, quality) for number in (1, 2, 3) for quality in qualities]
    assert drawn(image, [2, 4, 6]) == expected


def test_a_picture_with_all_its_detail_is_not_sent_again(image, monkeypatch):
    monkeypatch.setattr(module, "_STANDS_STILL", 0.0)
    assert drawn(image, [1, 2]) == [(number, DETAILS[0].quality) for number in (1, 2)]


def test_a_browser_here_draws_while_neither_camera_nor_tracker_are_busy(image, monkeypatch):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    monkeypatch.setattr(module, "_OTHER_CLOCK", 1e6)
    # Another frame is about to be sent when the second one is ready.
    second = NOW - INTERVAL + SECOND // 100
    stamps = (second - INTERVAL, second, second + INTERVAL)
    assert drawn_before_the_third(image, stamps) == [(1, 1), (1, 2)]


@pytest.mark.parametrize(
    ("interval", "age"),
    [
        pytest.param(INTERVAL, INTERVAL // 2, id="there is time before the next frame"),
        pytest.param(INTERVAL, INTERVAL + SECOND, id="the next frame has just been sent"),
        pytest.param(INTERVAL, 2 * 10**6 * SECOND - SECOND // 100, id="stamps of long ago"),
        pytest.param(INTERVAL, -SECOND // 100, id="stamps that are still to come"),
        pytest.param(SECOND // 100, SECOND // 100, id="frames that leave no time"),
        pytest.param(0, 0, id="stamps that stand still"),
        pytest.param(-INTERVAL, SECOND, id="stamps that go back"),
    ],
)
def test_else_it_draws_at_once(image, monkeypatch, interval, age):
    monkeypatch.setattr(module.time, "time_ns", lambda: NOW)
    monkeypatch.setattr(module, "_OTHER_CLOCK", 1e6)
    second = NOW - age
    stamps = (second - interval, second, second + interval)
    assert drawn_before_the_third(image, stamps) == [(1, 1), (2, 2)]
