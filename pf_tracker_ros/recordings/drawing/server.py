"""Asks for targets on a page, served on the loopback for as long as it takes. Needs aiohttp."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, NamedTuple

from aiohttp import web

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.pages.access import Access
from pf_tracker_ros.pages.serving import Site
from pf_tracker_ros.recordings.drawing.seekable_frames import EncodedFrame, SeekableFrames
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.tracking.input_checks import check_box

_PAGE = Path(__file__).with_name("page")
_HOST = "127.0.0.1"
# That of the console, so that one tunnel serves both; another one where it is taken.
_PORT = 8642
_LONGEST_LABEL = 100
# Digits of a frame's number; Python refuses to read thousands of them.
_LONGEST_NUMBER = 20


def prompt_for_targets(
    recording: Recording, max_targets: int, announce: Callable[[str], None]
) -> tuple[Target, ...]:
    """Show a page with the frames of a recording until somebody has drawn the targets on them.

    Args:
        recording: What is to be tracked in.
        max_targets: How many there may be, at least 1.
        announce: Called with the address of the page.

    Returns:
        At least one, in the order in which they were drawn.

    Raises:
        RecordingError: It was given up on the page, or the page cannot be served.
        FootageError: The recording cannot be read.
    """
    pictures = SeekableFrames(recording)
    desk = _Desk(recording, pictures, max_targets)
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
        max_targets: How many targets there may be.
    """

    def __init__(self, recording: Recording, pictures: SeekableFrames, max_targets: int) -> None:
        self._recording = recording
        self._pictures = pictures
        self._max_targets = max_targets
        self._targets: tuple[Target, ...] = ()
        self._runner: web.AppRunner | None = None
        self._is_decided = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._site = Site(Access(_HOST), _PAGE)
        router = self._site.application.router
        router.add_get("/recording", self._on_recording)
        router.add_get("/frame", self._on_frame)
        router.add_post("/targets", self._on_targets)
        router.add_post("/cancel", self._on_cancel)
        self._thread = threading.Thread(target=self._loop.run_forever, name="drawing", daemon=True)

    @property
    def address(self) -> str:
        return f"http://{_HOST}:{self._site.port}/"

    def start(self) -> None:
        self._thread.start()
        try:
            self._have_done(self._serve())
        except OSError as error:
            raise RecordingError(f"the page to draw on cannot be served: {error}") from error

    def wait(self) -> tuple[Target, ...]:
        self._is_decided.wait()
        if not self._targets:
            raise RecordingError("no target was drawn: the page was canceled; nothing was tracked")
        return self._targets

    def close(self) -> None:
        if self._thread.is_alive():
            self._have_done(self._stop())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        # Not in the thread: it may just be ending while it is told to.
        self._loop.close()

    def _have_done(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _serve(self) -> None:
        try:
            self._runner = await self._site.serve(_HOST, _PORT)
        except OSError:
            self._runner = await self._site.serve(_HOST, 0)

    async def _stop(self) -> None:
        if self._runner is not None:
            await self._runner.cleanup()
        await self._loop.shutdown_default_executor()

    async def _find(self, number: int) -> EncodedFrame:
        return await self._loop.run_in_executor(None, self._pictures.find, number)

    async def _on_recording(self, request: web.Request) -> web.Response:
        name, frames = self._recording.path.name, self._recording.frame_count
        return web.json_response({"name": name, "frames": frames, "max_targets": self._max_targets})

    async def _on_frame(self, request: web.Request) -> web.Response:
        number = request.query.get("number", "")
        if not number.isdecimal() or len(number) > _LONGEST_NUMBER:
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

    async def _on_targets(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        try:
            self._targets = await self._drawn(await request.read())
        except (ValueError, LookupError) as error:
            raise web.HTTPUnprocessableEntity(text=str(error)) from error
        return self._decided("tracking begins; this page can be closed")

    async def _drawn(self, text: bytes) -> tuple[Target, ...]:
        """The targets of a request.

        Raises:
            ValueError: One could not be tracked, or they are too many.
            LookupError: One is of a frame that is not there.
        """
        wanted = _wanted(text)
        if len(wanted) > self._max_targets:
            raise ValueError(f"there are {len(wanted)} targets; allowed: {self._max_targets}")
        # Each frame once and in their order, as going back reads the recording anew.
        pictures = {
            number: await self._find(number) for number in sorted({one.frame for one in wanted})
        }
        targets = []
        for number, one in enumerate(wanted, start=1):
            picture = pictures[one.frame]
            frame = picture.frame
            try:
                box = check_box(one.box, picture.size)
            except ValueError as error:
                raise ValueError(f"target {number}: {error}") from error
            targets.append(
                Target(box, frame.stamp, frame.index, picture.size, "the page", one.label)
            )
        return tuple(targets)

    async def _on_cancel(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        self._targets = ()
        return self._decided("nothing is tracked; this page can be closed")

    def _decided(self, text: str) -> web.Response:
        # Once the answer is on its way: the server ends with the decision, and waits for answers.
        self._loop.call_soon(self._is_decided.set)
        return web.Response(text=text)


class _Wanted(NamedTuple):
    """A target as a page asks for it; its box is not looked at yet."""

    frame: int
    box: Any
    label: str


def _wanted(text: bytes) -> list[_Wanted]:
    """The targets that a request is for, at least one.

    Raises:
        ValueError: It is for none.
    """
    try:
        request: Any = json.loads(text)
    except RecursionError as error:
        raise ValueError("the request has no targets") from error
    targets = request.get("targets") if isinstance(request, dict) else None
    if not isinstance(targets, list) or not targets:
        raise ValueError("the request has no targets")
    wanted = []
    for number, one in enumerate(targets, start=1):
        if not isinstance(one, dict) or not isinstance(one.get("frame"), int):
            raise ValueError(f"target {number}: the request tells no frame")
        label = one.get("label", "")
        if not isinstance(label, str) or not label.isprintable() or len(label) > _LONGEST_LABEL:
            raise ValueError(
                f"target {number}: its label is not allowed; allowed: up to {_LONGEST_LABEL} "
                "printable characters"
            )
        wanted.append(_Wanted(max(0, one["frame"]), one.get("box", ()), label))
    return wanted
