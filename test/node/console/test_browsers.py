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


class Page:
    """Draws each frame at once.

    Attributes:
        qualities: Number and quality of each frame that came.
    """

    def __init__(self, browsers):
        self._browsers = browsers
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


def drawn(image, counts):
    """Number and quality of what a page draws.

    Args:
        image: Of each frame that is shown.
        counts: How many the page is to have drawn before the next frame is shown, a frame each.
    """

    async def run():
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

    # In a thread: the tests with a real browser keep an event loop in this one.
    with ThreadPoolExecutor(1) as executor:
        return executor.submit(asyncio.run, run()).result()


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
