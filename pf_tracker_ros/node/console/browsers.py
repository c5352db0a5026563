"""The connected browsers: each gets the newest frame at its own rate, all get the same news."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from aiohttp import web

from pf_tracker_ros.node.console.frame_synchronizer import DisplayFrame
from pf_tracker_ros.node.console.image_encoding import (
    QUALITY_LEVELS,
    QualityLevel,
    count_usable_levels,
    encode_image,
    scale_for,
)
from pf_tracker_ros.node.console.json_conversions import Json, pack_frame
from pf_tracker_ros.node.console.rate_controller import RateController
from pf_tracker_ros.stamps import NANOSECONDS

# A picture with no successor for so long, in seconds, is sent again in full quality: users draw
# targets on it, and the link is idle.
_STILL_AFTER = 0.5
# With frames closer than this, in seconds, a local browser that draws at once would compete with
# the tracker for the CPU during the next frame.
_DELAYED_BELOW = 0.05
# Seconds to send a message; a sleeping browser would block the others longer.
_SEND_TIMEOUT = 4.0


class Browser:
    """A browser with the page, by its web socket; messages to a closing one are lost.

    A connection that accepts no data for a while is aborted; a browser that wakes up reconnects.

    Args:
        response: The web socket.
        transport: Its transport.
    """

    def __init__(
        self, response: web.WebSocketResponse, transport: asyncio.Transport | None
    ) -> None:
        self._response = response
        self._transport = transport

    @property
    def is_local(self) -> bool:
        """Whether the browser runs on this machine: both ends have the same address."""
        if not self._transport:
            return False
        browser, own = (self._transport.get_extra_info(end) for end in ("peername", "sockname"))
        return bool(browser and own and browser[0] == own[0])

    async def send_json(self, message: Json) -> None:
        """Send a message."""
        await self._send(self._response.send_str(json.dumps(message, allow_nan=False)))

    async def send_bytes(self, message: bytes) -> None:
        """Send a frame."""
        await self._send(self._response.send_bytes(message))

    async def _send(self, sending: Coroutine[Any, Any, None]) -> None:
        try:
            await asyncio.wait_for(sending, _SEND_TIMEOUT)
        except asyncio.TimeoutError:
            if self._transport:
                self._transport.abort()
        except (ConnectionError, RuntimeError):
            return


class _Viewer:
    """State of a browser: rate, last frame, and width of its window."""

    def __init__(self) -> None:
        self.rate = RateController(time.monotonic())
        self.number = self.stamp = 0
        # Whether that frame had the best quality for the window.
        self.is_sharp = True
        self.width: float | None = None


class Browsers:
    """The connected browsers.

    Args:
        newest: Returns the frame to show, None before the first.
        index_of: Returns the index in the recording of a frame's stamp, None for a camera's.
    """

    def __init__(
        self,
        newest: Callable[[], DisplayFrame | None],
        index_of: Callable[[int], int | None] = lambda stamp: None,
    ) -> None:
        self._newest = newest
        self._index_of = index_of
        self._viewers: dict[Browser, _Viewer] = {}
        self._changed = asyncio.Condition()
        self._encoder = ThreadPoolExecutor(1, "encoder")
        self._encoded: dict[tuple[int, QualityLevel], asyncio.Future[tuple[int, bytes]]] = {}
        self._image_width = 0

    def __len__(self) -> int:
        return len(self._viewers)

    def __contains__(self, browser: Browser) -> bool:
        return browser in self._viewers

    def close(self) -> None:
        """Stop the encoder."""
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def add(self, browser: Browser) -> None:
        """Add a browser."""
        self._viewers[browser] = _Viewer()

    def remove(self, browser: Browser) -> None:
        """Remove a browser."""
        self._viewers.pop(browser, None)

    async def stream(self, browser: Browser, news: Sequence[Json]) -> None:
        """Send a browser first the news, then frames at its own rate, until canceled.

        A local browser draws a frame only on request, see `_DELAYED_BELOW`.
        """
        viewer = self._viewers[browser]
        viewer.rate.start_round_trip(time.monotonic())
        for message in news:
            await browser.send_json(message)
        while True:
            is_still = not await self._has_newer(
                viewer, within=None if viewer.is_sharp else _STILL_AFTER
            )
            await viewer.rate.acquire()
            frame = self._newest()
            if frame is None:
                # Another recording has been opened meanwhile.
                continue
            ahead = frame.number - viewer.number if viewer.number else 0
            interval = (frame.stamp - viewer.stamp) / ahead / NANOSECONDS if ahead else 0.0
            viewer.number, viewer.stamp = frame.number, frame.stamp
            viewer.rate.level_count = count_usable_levels(self._image_width)
            level = self._for_window(viewer, viewer.rate.quality_level)
            sharpest = self._for_window(viewer, QUALITY_LEVELS[0])
            if is_still:
                level = sharpest
            viewer.is_sharp = level == sharpest
            packed = await self._encode(frame, level)
            if not browser.is_local:
                viewer.rate.send(max(0, ahead - 1), time.monotonic())
                await browser.send_bytes(packed)
                continue
            await browser.send_bytes(packed)
            if 0.0 < interval < _DELAYED_BELOW:
                # Draw once the tracker has finished the next frame.
                await self._has_newer(viewer, within=interval)
            viewer.rate.send(max(0, ahead - 1), time.monotonic())
            await browser.send_json({"type": "draw"})

    async def notify_new_frame(self) -> None:
        """Wake the streams: there is a new frame."""
        async with self._changed:
            self._changed.notify_all()

    async def broadcast(self, message: Json) -> None:
        """Send a message to all browsers."""
        await asyncio.gather(*(browser.send_json(message) for browser in list(self._viewers)))

    def end_round_trip(self, browser: Browser) -> None:
        """Process a browser's acknowledgment of its welcome."""
        if viewer := self._viewers.get(browser):
            viewer.rate.end_round_trip(time.monotonic())

    def acknowledge(self, browser: Browser) -> None:
        """Process a browser's acknowledgment of a frame that it has drawn."""
        if viewer := self._viewers.get(browser):
            viewer.rate.acknowledge(time.monotonic())

    async def set_width(self, browser: Browser, width: float) -> None:
        """Set the width of the picture in a browser, in pixels of its screen."""
        if viewer := self._viewers.get(browser):
            is_wider = viewer.width is not None and width > viewer.width
            viewer.width = width
            if is_wider:
                # A still picture is sent again, sharp enough for the wider window.
                viewer.number = 0
                await self.notify_new_frame()

    @property
    def _newest_number(self) -> int:
        newest = self._newest()
        return newest.number if newest else 0

    async def _has_newer(self, viewer: _Viewer, within: float | None) -> bool:
        """Wait for a frame that is newer than the browser's, at most `within` seconds if given.

        Returns:
            False if there was none in time.
        """

        async def wait() -> None:
            async with self._changed:
                await self._changed.wait_for(lambda: self._newest_number > viewer.number)

        try:
            await asyncio.wait_for(wait(), within)
        except asyncio.TimeoutError:
            return False
        return True

    def _for_window(self, viewer: _Viewer, level: QualityLevel) -> QualityLevel:
        """A quality level with no more pixels than the window shows."""
        if viewer.width is None:
            return level
        scale = min(level.scale, scale_for(self._image_width, viewer.width))
        return QualityLevel(level.quality, scale)

    async def _encode(self, frame: DisplayFrame, level: QualityLevel) -> bytes:
        """An encoded frame; encoded once for all browsers with the same quality level."""
        key = (frame.number, level)
        if key not in self._encoded:
            self._encoded = {k: v for k, v in self._encoded.items() if k[0] == frame.number}
            loop = asyncio.get_running_loop()
            index = self._index_of(frame.stamp)
            self._encoded[key] = loop.run_in_executor(self._encoder, _encoded, frame, level, index)
        self._image_width, packed = await asyncio.shield(self._encoded[key])
        return packed


def _encoded(frame: DisplayFrame, level: QualityLevel, index: int | None) -> tuple[int, bytes]:
    """The width of the image, pixels, and the packed frame."""
    picture = encode_image(frame.image, level)
    header = {
        "stamp": str(frame.stamp),
        "index": index,
        "width": picture.width,
        "height": picture.height,
        "quality": level.quality,
        "error": picture.error,
        **frame.results,
    }
    return picture.width, pack_frame(header, picture.jpeg)
