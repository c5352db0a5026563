"""The frames that a browser gets, and their quality."""

import asyncio
import contextlib
import json
import struct

import cv2
import numpy as np
import pytest
from console_pages import run_apart

pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")

from pf_tracker_ros.node.console import browsers as module
from pf_tracker_ros.node.console.browsers import Browsers
from pf_tracker_ros.node.console.frame_synchronizer import DisplayFrame
from pf_tracker_ros.node.console.image_encoding import QUALITY_LEVELS
from pf_tracker_ros.node.console.rate_controller import RateController

SLOW = QUALITY_LEVELS[3]
SECOND = 10**9
# No test waits for the end of one.
INTERVAL = 1000 * SECOND


class Page:
    """Draws each frame at once, or on request if it is local.

    Attributes:
        is_local: Whether it runs on the console's machine.
        received: Number of frames received.
        qualities: Stamp and quality of each frame drawn.
        widths: Of each picture received, pixels.
    """

    def __init__(self, browsers, is_local=True):
        self._browsers = browsers
        self.is_local = is_local
        self.received = 0
        self.qualities = []
        self.widths = []
        self._frame = None
        self._changed = asyncio.Event()

    async def send_json(self, message):
        assert message == {"type": "draw"}
        assert self.is_local
        self._draw()

    async def send_bytes(self, message):
        (length,) = struct.unpack(">I", message[:4])
        assert self._frame is None
        self._frame = json.loads(message[4 : 4 + length])
        jpeg = np.frombuffer(message[4 + length :], np.uint8)
        self.widths.append(cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape[1])
        self.received += 1
        self._changed.set()
        if not self.is_local:
            self._draw()

    def _draw(self):
        self.qualities.append((int(self._frame["stamp"]), self._frame["quality"]))
        self._frame = None
        self._browsers.acknowledge(self)
        self._changed.set()

    async def wait_for(self, count):
        await self._until(lambda: len(self.qualities) >= count)

    async def wait_to_receive(self, count):
        await self._until(lambda: self.received >= count)

    async def _until(self, condition):
        while not condition():
            self._changed.clear()
            await asyncio.wait_for(self._changed.wait(), 60.0)


@contextlib.asynccontextmanager
async def streaming(image, *are_local):
    """Pages, local ones or not, and a function that shows them a frame of the image."""
    shown = None
    browsers = Browsers(lambda: shown)
    pages = [Page(browsers, is_local) for is_local in are_local]
    tasks = []
    for page in pages:
        browsers.add(page)
        tasks.append(asyncio.ensure_future(browsers.stream(page, [])))

    async def show(number, stamp):
        nonlocal shown
        shown = DisplayFrame(number, stamp, image, {})
        await browsers.notify_new_frame()

    yield pages, show
    for task in tasks:
        task.cancel()
    browsers.close()


def drawn(image, counts, stamps=None):
    """A page that has drawn frames.

    Args:
        image: Of each frame that is shown.
        counts: Number of frames to wait for after each frame that is shown.
        stamps: Of the frames; 1, 2 and so on if not given.
    """

    async def play():
        async with streaming(image, True) as ((page,), show):
            for number, count in enumerate(counts, 1):
                await show(number, stamps[number - 1] if stamps else number)
                await page.wait_for(count)
        return page

    return run_apart(play())


def drawn_before_the_third(image, stamps):
    """Number of frames that a local and a remote page have drawn, after the first and the second.

    Args:
        image: Of each frame.
        stamps: Of three frames; with the third, the local page has to draw the second.
    """

    async def play():
        counts = []
        async with streaming(image, True, False) as ((local, remote), show):
            for number, stamp in enumerate(stamps, 1):
                await show(number, stamp)
                await remote.wait_for(number)
                await local.wait_to_receive(min(number, 2))
                counts.append((len(local.qualities), len(remote.qualities)))
            await local.wait_for(2)
        return counts[:2]

    return run_apart(play())


@pytest.fixture
def image(client):
    """A message."""
    return client.message(np.zeros((48, 64, 3), np.uint8))


def test_a_still_picture_is_sent_once_more_in_full_quality(image, monkeypatch):
    monkeypatch.setattr(RateController, "quality_level", SLOW)
    monkeypatch.setattr(module, "_STILL_AFTER", 0.05)
    qualities = (SLOW.quality, QUALITY_LEVELS[0].quality)
    expected = [(number, quality) for number in (1, 2, 3) for quality in qualities]
    assert drawn(image, [2, 4, 6]).qualities == expected


class FullLink(RateController):
    """Of the worst quality, which no acknowledgment raises."""

    def __init__(self, now):
        super().__init__(now)
        self._level = len(QUALITY_LEVELS) - 1

    def acknowledge(self, now):
        super().acknowledge(0.0)


def test_a_full_link_gets_fewer_pictures_instead_of_ones_too_narrow_to_draw_on(client, monkeypatch):
    monkeypatch.setattr(module, "RateController", FullLink)
    page = drawn(client.message(np.zeros((480, 640, 3), np.uint8)), [1, 2, 3])
    assert min(page.widths) == 320


def test_a_picture_in_full_quality_is_not_sent_again(image, monkeypatch):
    monkeypatch.setattr(module, "_STILL_AFTER", 0.0)
    expected = [(number, QUALITY_LEVELS[0].quality) for number in (1, 2)]
    assert drawn(image, [1, 2]).qualities == expected


def test_a_local_browser_draws_a_frame_after_the_status_of_the_next(image, monkeypatch):
    monkeypatch.setattr(module, "_DELAYED_BELOW", 2.0 * INTERVAL / SECOND)
    stamps = (INTERVAL, 2 * INTERVAL, 3 * INTERVAL)
    assert drawn_before_the_third(image, stamps) == [(1, 1), (1, 2)]


@pytest.mark.parametrize(
    "interval",
    [
        pytest.param(INTERVAL, id="there is time before the next frame"),
        pytest.param(SECOND // 100, id="the next frame does not come"),
        pytest.param(0, id="stamps that stand still"),
        pytest.param(-INTERVAL, id="stamps that go back"),
    ],
)
def test_otherwise_a_local_browser_draws_at_once(image, interval):
    stamps = (2 * INTERVAL, 2 * INTERVAL + interval)
    assert [stamp for stamp, _ in drawn(image, [1, 2], stamps).qualities] == list(stamps)
