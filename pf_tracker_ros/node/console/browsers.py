"""The pages that are open: each gets the newest frame at its own pace, all get the same news."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

from pf_tracker_ros.node.console.frame_synchronizer import DisplayFrame
from pf_tracker_ros.node.console.image_encoding import (
    QUALITY_LEVELS,
    QualityLevel,
    encode_image,
    scale_for,
)
from pf_tracker_ros.node.console.json_conversions import Json, pack_frame
from pf_tracker_ros.node.console.rate_controller import RateController
from pf_tracker_ros.stamps import NANOSECONDS

# A picture that none follows for so long, in seconds, is sent in all its detail: that is the one to
# draw on, and the link has nothing else to do.
_STANDS_STILL = 0.5
# Where frames come closer, in seconds, a browser here that draws one at once is still at it when
# the tracker needs its time for the next one.
_LEAVES_TIME = 0.05


class Browser(Protocol):
    """One page that is open."""

    @property
    def is_local(self) -> bool:
        """Whether it is on this machine."""

    async def send_json(self, message: Json) -> None:
        """Send a message; one to a browser that has gone is lost."""

    async def send_bytes(self, message: bytes) -> None:
        """Send a frame."""


class _Viewer:
    """What is known of a browser: its pace, the frame it got last, and its window's width."""

    def __init__(self) -> None:
        self.pace = RateController(time.monotonic())
        self.number = self.stamp = 0
        # Whether that frame had all the detail there is.
        self.is_sharp = True
        self.width: float | None = None


class Browsers:
    """The browsers, from their welcome until they are gone.

    Args:
        newest: Gives the frame to show, None before the first.
    """

    def __init__(self, newest: Callable[[], DisplayFrame | None]) -> None:
        self._newest = newest
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
        """Encode no more."""
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def add(self, browser: Browser) -> None:
        """Take a browser in; `remove` lets it go."""
        self._viewers[browser] = _Viewer()

    def remove(self, browser: Browser) -> None:
        """Forget a browser."""
        self._viewers.pop(browser, None)

    async def stream(self, browser: Browser, news: Sequence[Json]) -> None:
        """Give a browser first the news and then every frame that it bears, until canceled.

        One on this machine is told when to draw a frame that it has got.
        """
        viewer = self._viewers[browser]
        viewer.pace.start_round_trip(time.monotonic())
        for message in news:
            await browser.send_json(message)
        while True:
            stands_still = not await self._has_newer(
                viewer, within=None if viewer.is_sharp else _STANDS_STILL
            )
            await viewer.pace.acquire()
            shown = self._newest()
            assert shown is not None
            ahead = shown.number - viewer.number if viewer.number else 0
            interval = (shown.stamp - viewer.stamp) / ahead / NANOSECONDS if ahead else 0.0
            viewer.number, viewer.stamp = shown.number, shown.stamp
            detail = self._for_window(viewer, viewer.pace.quality_level)
            sharpest = self._for_window(viewer, QUALITY_LEVELS[0])
            if stands_still:
                detail = sharpest
            viewer.is_sharp = detail == sharpest
            frame = await self._encode(shown, detail)
            if not browser.is_local:
                viewer.pace.send(max(0, ahead - 1), time.monotonic())
                await browser.send_bytes(frame)
                continue
            await browser.send_bytes(frame)
            if 0.0 < interval < _LEAVES_TIME:
                # Once the next frame is answered, there is time until the one after it.
                await self._has_newer(viewer, within=interval)
            viewer.pace.send(max(0, ahead - 1), time.monotonic())
            await browser.send_json({"type": "draw"})

    async def notify_new_frame(self) -> None:
        """There is another frame to show."""
        async with self._changed:
            self._changed.notify_all()

    async def broadcast(self, message: Json) -> None:
        """Tell all of them something."""
        await asyncio.gather(*(browser.send_json(message) for browser in list(self._viewers)))

    def end_round_trip(self, browser: Browser) -> None:
        """A browser has answered its welcome."""
        if viewer := self._viewers.get(browser):
            viewer.pace.end_round_trip(time.monotonic())

    def acknowledge(self, browser: Browser) -> None:
        """A browser has drawn a frame."""
        if viewer := self._viewers.get(browser):
            viewer.pace.acknowledge(time.monotonic())

    async def set_width(self, browser: Browser, width: float) -> None:
        """Note how wide a browser shows the picture, in pixels of its screen."""
        if viewer := self._viewers.get(browser):
            is_wider = viewer.width is not None and width > viewer.width
            viewer.width = width
            if is_wider:
                # A picture that stands still is to be as sharp as one that moves.
                viewer.number = 0
                await self.notify_new_frame()

    @property
    def _newest_number(self) -> int:
        newest = self._newest()
        return newest.number if newest else 0

    async def _has_newer(self, viewer: _Viewer, within: float | None) -> bool:
        """Wait for a frame that a browser has not got, for some seconds or as long as it takes.

        Returns:
            False where there was none.
        """

        async def wait() -> None:
            async with self._changed:
                await self._changed.wait_for(lambda: self._newest_number > viewer.number)

        try:
            await asyncio.wait_for(wait(), within)
        except asyncio.TimeoutError:
            return False
        return True

    def _for_window(self, viewer: _Viewer, detail: QualityLevel) -> QualityLevel:
        """A detail, and no more of it than the window shows."""
        if viewer.width is None:
            return detail
        scale = min(detail.scale, scale_for(self._image_width, viewer.width))
        return QualityLevel(detail.quality, scale)

    async def _encode(self, shown: DisplayFrame, detail: QualityLevel) -> bytes:
        """A frame as it is sent, made once for all browsers that get it in the same detail."""
        key = (shown.number, detail)
        if key not in self._encoded:
            self._encoded = {k: v for k, v in self._encoded.items() if k[0] == shown.number}
            loop = asyncio.get_running_loop()
            self._encoded[key] = loop.run_in_executor(self._encoder, _encoded, shown, detail)
        self._image_width, frame = await asyncio.shield(self._encoded[key])
        return frame


def _encoded(shown: DisplayFrame, detail: QualityLevel) -> tuple[int, bytes]:
    """The width of the image, and the frame."""
    picture = encode_image(shown.image, detail)
    header = {
        "stamp": str(shown.stamp),
        "width": picture.width,
        "height": picture.height,
        "quality": detail.quality,
        "error": picture.error,
        **shown.answer,
    }
    return picture.width, pack_frame(header, picture.jpeg)
