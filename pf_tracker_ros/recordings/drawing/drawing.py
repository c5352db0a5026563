"""Asks for a target on a page, served on the loopback for as long as it takes. Needs aiohttp."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aiohttp import web

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.pages.access import Access
from pf_tracker_ros.pages.serving import Site
from pf_tracker_ros.recordings.drawing.pictures import FramePicture, Pictures
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.tracking.input_checks import check_box

_PAGE = Path(__file__).with_name("page")
_HOST = "127.0.0.1"
# That of the console, so that one tunnel serves both; another one where it is taken.
_PORT = 8642
# A request is a box, never more than this.
_LARGEST_REQUEST = 4096


def draw_target(recording: Recording, announce: Callable[[str], None]) -> Target:
    """Show a page with the frames of a recording until somebody has drawn the target on one.

    Args:
        recording: What is to be tracked in.
        announce: Called with the address of the page.

    Raises:
        RecordingError: It was given up on the page, or the page cannot be served.
        FootageError: The recording cannot be read.
    """
    pictures = Pictures(recording)
    desk = _Desk(recording, pictures)
    try:
        # What cannot be read at all is told here, and not on a page.
        try:
            pictures.find(0)
        except LookupError as error:
            raise RecordingError(f"{recording.path} cannot be drawn on: {error}") from error
        desk.start()
        announce(desk.address)
        return desk.wait()
    finally:
        pictures.close()
        desk.close()


class _Desk:
    """The server, in a thread with an event loop of its own: this one waits, and hears signals.

    Args:
        recording: What is drawn on.
        pictures: Its frames.
    """

    def __init__(self, recording: Recording, pictures: Pictures) -> None:
        self._recording = recording
        self._pictures = pictures
        self._target: Target | None = None
        self._error: OSError | None = None
        self._is_decided = threading.Event()
        self._is_started = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self._site = Site(Access(_HOST), _PAGE)
        router = self._site.application.router
        router.add_get("/recording", self._on_recording)
        router.add_get("/frame", self._on_frame)
        router.add_post("/target", self._on_target)
        router.add_post("/cancel", self._on_cancel)
        self._thread = threading.Thread(target=self._serve, name="drawing", daemon=True)

    @property
    def address(self) -> str:
        return f"http://{_HOST}:{self._site.port}/"

    def start(self) -> None:
        self._thread.start()
        self._is_started.wait()
        if self._error:
            raise RecordingError(f"the page to draw on cannot be served: {self._error}")

    def wait(self) -> Target:
        self._is_decided.wait()
        if self._target is None:
            raise RecordingError("no target was drawn: the page was canceled; nothing was tracked")
        return self._target

    def close(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopping.set)
            self._thread.join()
        else:
            self._loop.close()

    def _serve(self) -> None:
        with contextlib.closing(self._loop):
            self._loop.run_until_complete(self._run())

    async def _run(self) -> None:
        try:
            try:
                runner = await self._site.serve(_HOST, _PORT)
            except OSError:
                runner = await self._site.serve(_HOST, 0)
        except OSError as error:
            self._error = error
            return
        finally:
            if self._error:
                self._is_started.set()
        self._is_started.set()
        await self._stopping.wait()
        await runner.cleanup()
        await self._loop.shutdown_default_executor()

    async def _find(self, number: int) -> FramePicture:
        return await self._loop.run_in_executor(None, self._pictures.find, number)

    async def _on_recording(self, request: web.Request) -> web.Response:
        count = self._recording.frame_count
        return web.json_response({"name": self._recording.path.name, "frames": count})

    async def _on_frame(self, request: web.Request) -> web.Response:
        number = request.query.get("number", "")
        if not number.isdecimal():
            raise web.HTTPBadRequest(text="'number' is none; allowed: whole numbers from 0")
        try:
            picture = await self._find(int(number))
        except (LookupError, FootageError) as error:
            raise web.HTTPNotFound(text=str(error)) from error
        width, height = picture.size
        return web.Response(
            body=picture.jpeg,
            content_type="image/jpeg",
            headers={"X-Frame": str(picture.frame.index), "X-Size": f"{width} {height}"},
        )

    async def _on_target(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        try:
            self._target = await self._drawn(await request.content.read(_LARGEST_REQUEST))
        except (ValueError, LookupError) as error:
            raise web.HTTPUnprocessableEntity(text=str(error)) from error
        return self._decided("tracking begins; this page can be closed")

    async def _drawn(self, text: bytes) -> Target:
        """The target of a request.

        Raises:
            ValueError: It is none that could be tracked.
            LookupError: It is of a frame that is not there.
        """
        try:
            wanted: Any = json.loads(text)
        except RecursionError as error:
            raise ValueError("the request is no box") from error
        if not isinstance(wanted, dict) or not isinstance(wanted.get("frame"), int):
            raise ValueError("the request tells no frame")
        picture = await self._find(max(0, wanted["frame"]))
        box = check_box(wanted.get("box", ()), picture.size)
        frame = picture.frame
        return Target(box, frame.stamp, frame.index, picture.size, "the page")

    async def _on_cancel(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        self._target = None
        return self._decided("nothing is tracked; this page can be closed")

    def _decided(self, text: str) -> web.Response:
        # Once the answer is on its way: the server ends with the decision, and waits for answers.
        self._loop.call_soon(self._is_decided.set)
        return web.Response(text=text)
