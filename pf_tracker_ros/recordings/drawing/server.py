"""A page on the loopback, from drawing the targets to the report. Needs aiohttp."""

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
from pf_tracker_ros.recordings.drawing.progress import RESULTS_POLICY, Progress, WrittenFiles
from pf_tracker_ros.recordings.drawing.seekable_frames import EncodedFrame, SeekableFrames
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.tracking.input_checks import check_box

_PAGE = Path(__file__).with_name("page")
_HOST = "127.0.0.1"
# The console's port, so that one tunnel serves both; a free one if it is in use.
_PORT = 8642
_MAX_LABEL = 100
# Digits of a frame's number; Python refuses to convert thousands of them.
_MAX_DIGITS = 20


class TargetPage:
    """The page of a run of `track`: the targets are drawn, then tracked before the user's eyes.

    1. `ask` serves the page until the user has drawn the targets.
    2. `show` is called with each tracked frame. The page has the progress and the newest picture.
    3. `finish` shows the report on the page, and returns when the page is closed.

    The server runs in a thread with an event loop of its own; the caller's thread keeps signals.

    Args:
        announce: Called with the address of the page.
    """

    def __init__(self, announce: Callable[[str], None]) -> None:
        self._announce = announce
        self._recording: Recording | None = None
        self._frames: SeekableFrames | None = None
        self._max_targets = 1
        self._targets: tuple[Target, ...] = ()
        self._runner: web.AppRunner | None = None
        self._is_decided = threading.Event()
        self._progress = Progress()
        self._results: WrittenFiles | None = None
        self._loop = asyncio.new_event_loop()
        self._site = Site(Access(_HOST), _PAGE)
        router = self._site.application.router
        router.add_get("/recording", self._on_recording)
        router.add_get("/frame", self._on_frame)
        router.add_post("/targets", self._on_targets)
        router.add_post("/cancel", self._on_cancel)
        router.add_get("/progress", self._progress.on_request)
        router.add_get("/picture", self._progress.on_picture)
        router.add_get("/results/{name:.+}", self._on_results)
        self._thread = threading.Thread(target=self._loop.run_forever, name="drawing", daemon=True)

    def ask(self, recording: Recording, max_targets: int) -> tuple[Target, ...]:
        """Serve the page with the frames of a recording until the user has drawn the targets.

        Args:
            recording: The recording.
            max_targets: Maximum number of targets, at least 1.

        Returns:
            At least one target, in the order of drawing.

        Raises:
            RecordingError: The user has canceled, or the page cannot be served.
            FootageError: The recording cannot be read.
        """
        self._recording, self._max_targets = recording, max_targets
        self._frames = frames = SeekableFrames(recording)
        try:
            # An unreadable recording needs no page.
            try:
                frames.find(0)
            except LookupError as error:
                raise RecordingError(f"{recording.path} cannot be drawn on: {error}") from error
            self._start()
            self._announce(f"http://{_HOST}:{self._site.port}/")
            self._is_decided.wait()
        finally:
            frames.close()
        if not self._targets:
            raise RecordingError("no target was drawn: the page was canceled; nothing was tracked")
        self._progress.begin(recording.frame_count)
        return self._targets

    def show(self, tracked: TrackedFrame) -> None:
        """Show the progress."""
        self._progress.show(tracked)

    def finish(self, text: str, results: WrittenFiles) -> None:
        """Show the results; with a report, return when the page is closed, else at once.

        Args:
            text: How it went.
            results: The written files.
        """
        self._results = results
        self._progress.finish(text, results)

    def close(self) -> None:
        """Stop the server."""
        if self._thread.is_alive():
            self._run(self._stop())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        # Not in the loop's thread, which may just be ending.
        self._loop.close()

    def _start(self) -> None:
        self._thread.start()
        try:
            self._run(self._serve())
        except OSError as error:
            raise RecordingError(f"the page to draw on cannot be served: {error}") from error

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _serve(self) -> None:
        try:
            self._runner = await self._site.serve(_HOST, _PORT)
        except OSError:
            self._runner = await self._site.serve(_HOST, 0)

    async def _stop(self) -> None:
        self._progress.stop()
        if self._runner is not None:
            await self._runner.cleanup()
        await self._loop.shutdown_default_executor()

    async def _find(self, number: int) -> EncodedFrame:
        assert self._frames is not None
        return await self._loop.run_in_executor(None, self._frames.find, number)

    async def _on_recording(self, request: web.Request) -> web.Response:
        assert self._recording is not None
        name, frames = self._recording.path.name, self._recording.frame_count
        return web.json_response({"name": name, "frames": frames, "max_targets": self._max_targets})

    async def _on_frame(self, request: web.Request) -> web.Response:
        number = request.query.get("number", "")
        if not number.isdecimal() or len(number) > _MAX_DIGITS:
            raise web.HTTPBadRequest(text="'number' is invalid; allowed: integers from 0")
        try:
            found = await self._find(int(number))
        except (LookupError, FootageError) as error:
            raise web.HTTPNotFound(text=str(error)) from error
        width, height = found.size
        return web.Response(
            body=found.jpeg,
            content_type="image/jpeg",
            headers={"X-Frame": str(found.frame.index), "X-Size": f"{width} {height}"},
        )

    async def _on_targets(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        try:
            self._targets = await self._read_targets(await request.read())
        except (ValueError, LookupError) as error:
            raise web.HTTPUnprocessableEntity(text=str(error)) from error
        return self._decide("tracking; the outcome comes here")

    async def _read_targets(self, text: bytes) -> tuple[Target, ...]:
        """The targets of a request.

        Raises:
            ValueError: A target is invalid, or there are too many.
            LookupError: A target's frame does not exist.
        """
        requests = _parse(text)
        if len(requests) > self._max_targets:
            raise ValueError(f"there are {len(requests)} targets; allowed: {self._max_targets}")
        # Each frame once and in order, as going back restarts the recording.
        frames = {
            number: await self._find(number) for number in sorted({one.frame for one in requests})
        }
        targets = []
        for number, one in enumerate(requests, start=1):
            found = frames[one.frame]
            frame = found.frame
            try:
                box = check_box(one.box, found.size)
            except ValueError as error:
                raise ValueError(f"target {number}: {error}") from error
            targets.append(Target(box, frame.stamp, frame.index, found.size, "the page", one.label))
        return tuple(targets)

    async def _on_cancel(self, request: web.Request) -> web.Response:
        self._site.check_origin(request)
        self._targets = ()
        return self._decide("nothing is tracked; this page can be closed")

    async def _on_results(self, request: web.Request) -> web.StreamResponse:
        path = self._results and self._results.find(request.match_info["name"])
        if not path:
            raise web.HTTPNotFound(text="there is no such result")
        return web.FileResponse(path, headers={"Content-Security-Policy": RESULTS_POLICY})

    def _decide(self, text: str) -> web.Response:
        # Scheduled, so that the response is under way when the server stops.
        self._loop.call_soon(self._is_decided.set)
        return web.Response(text=text)


class _TargetRequest(NamedTuple):
    """A requested target; its box is not checked yet."""

    frame: int
    box: Any
    label: str


def _parse(text: bytes) -> list[_TargetRequest]:
    """The targets of a request, at least one.

    Raises:
        ValueError: The request is invalid.
    """
    try:
        request: Any = json.loads(text)
    except RecursionError as error:
        raise ValueError("the request has no targets") from error
    targets = request.get("targets") if isinstance(request, dict) else None
    if not isinstance(targets, list) or not targets:
        raise ValueError("the request has no targets")
    requests = []
    for number, one in enumerate(targets, start=1):
        if not isinstance(one, dict) or not isinstance(one.get("frame"), int):
            raise ValueError(f"target {number}: its 'frame' is no integer")
        label = one.get("label", "")
        if not isinstance(label, str) or not label.isprintable() or len(label) > _MAX_LABEL:
            raise ValueError(
                f"target {number}: its label is invalid; allowed: up to {_MAX_LABEL} "
                "printable characters"
            )
        requests.append(_TargetRequest(max(0, one["frame"]), one.get("box", ()), label))
    return requests
