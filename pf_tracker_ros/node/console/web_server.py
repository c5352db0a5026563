"""The web server: files of the page, a web socket for each browser, and access control.

It runs in a thread with an event loop of its own, so no browser can block the node's executor.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from pf_tracker_ros.node.console.bridge import ConsoleBridge
from pf_tracker_ros.node.console.browsers import Browser
from pf_tracker_ros.node.console.requests import RequestError
from pf_tracker_ros.pages.access import Access
from pf_tracker_ros.pages.serving import Site

_PAGE = Path(__file__).with_name("page")
_PARAMETER_FILE = "tracker.yaml"
# Bytes; a request is a box or a parameter.
_MAX_REQUEST = 65_536
# Seconds between pings; a browser without a reply within half of this has gone.
_HEARTBEAT = 20.0
_START_TIMEOUT = 10.0
_CANCEL_INTERVAL = 0.1
# How often tasks are canceled at the end; seconds that slow browsers are waited for there.
_CANCELLATIONS, _PATIENCE = 20, 1.0
_LOG = logging.getLogger(__name__)


class WebServer:
    """Serves the page from `start` until `close`.

    Attributes:
        access: Access control.

    Args:
        host: Address or name to serve on.
        port: To serve on; 0 selects a free one.
        create_bridge: Called in the server's event loop.
    """

    def __init__(self, host: str, port: int, create_bridge: Callable[[], ConsoleBridge]) -> None:
        self.access = Access(host)
        self._site = Site(self.access, _PAGE)
        self._host = host
        self._port = port
        self._create_bridge = create_bridge
        self._bridge: ConsoleBridge | None = None
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self._started = threading.Event()
        self._error: OSError | None = None
        self._received: deque[tuple[str, int, Any]] = deque()
        self._is_woken = False
        self._sockets: set[web.WebSocketResponse] = set()
        self._thread = threading.Thread(target=self._serve, name="web server", daemon=True)

    @property
    def url(self) -> str:
        """The address to open, with the token where one is required."""
        # A browser cannot open the wildcard address.
        host = socket.gethostname() if self._host in ("0.0.0.0", "::") else self._host
        host = f"[{host}]" if ":" in host else host
        token = f"?token={self.access.token}" if self.access.token else ""
        return f"http://{host}:{self._port}/{token}"

    def start(self) -> None:
        """Start to serve.

        Raises:
            OSError: The address cannot be served on.
        """
        self._thread.start()
        if not self._started.wait(_START_TIMEOUT):
            raise OSError(f"the web server did not start within {_START_TIMEOUT:g} s")
        if self._error:
            raise self._error

    def close(self) -> None:
        """Close all web sockets and stop."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopping.set)
            self._thread.join()

    def receive(self, kind: str, stamp: int, content: Any) -> None:
        """Pass a message of the tracker to the bridge; called from any thread."""
        self._received.append((kind, stamp, content))
        # One wake-up for several messages: it costs more than a message.
        if not self._is_woken:
            self._is_woken = True
            with contextlib.suppress(RuntimeError):  # The loop may just have been closed.
                self._loop.call_soon_threadsafe(self._receive)

    def _receive(self) -> None:
        self._is_woken = False
        while self._received:
            received = self._received.popleft()
            if self._bridge:
                self._bridge.receive(*received)

    def _serve(self) -> None:
        with contextlib.closing(self._loop):
            self._loop.run_until_complete(self._run())

    async def _run(self) -> None:
        router = self._site.application.router
        router.add_get("/socket", self._on_socket)
        router.add_get(f"/{_PARAMETER_FILE}", self._on_parameter_file)
        try:
            runner = await self._site.serve(self._host, self._port)
        except OSError as error:
            self._error = error
            self._started.set()
            return
        self._port = self._site.port
        self._bridge = self._create_bridge()
        running = asyncio.ensure_future(self._bridge.run())
        self._started.set()
        await self._stopping.wait()
        running.cancel()
        # All at once: each waits for its browser.
        closing = [asyncio.ensure_future(each.close(code=1001)) for each in self._sockets]
        if closing:
            await asyncio.wait(closing, timeout=_PATIENCE)
        await runner.cleanup()
        await _end_tasks()
        self._bridge.close()

    async def _on_parameter_file(self, request: web.Request) -> web.Response:
        assert self._bridge is not None
        try:
            text = self._bridge.parameter_file()
        except RequestError as error:
            raise web.HTTPServiceUnavailable(text=str(error)) from error
        disposition = f'attachment; filename="{_PARAMETER_FILE}"'
        return web.Response(
            text=text,
            content_type="application/yaml",
            headers={"Content-Disposition": disposition},
        )

    async def _on_socket(self, request: web.Request) -> web.WebSocketResponse:
        self._site.check_origin(request)
        response = web.WebSocketResponse(
            heartbeat=_HEARTBEAT, max_msg_size=_MAX_REQUEST, compress=False
        )
        try:
            await response.prepare(request)
        except ConnectionError:
            # The browser has gone already.
            return response
        assert self._bridge is not None
        browser = Browser(response, request.transport)
        self._sockets.add(response)
        streaming = asyncio.ensure_future(self._stream(browser, response))
        requests: set[asyncio.Task[None]] = set()
        try:
            async for message in response:
                if message.type == WSMsgType.TEXT:
                    # Not awaited: acknowledgments of frames must not wait for a service.
                    task = asyncio.ensure_future(self._bridge.handle(browser, _read(message.data)))
                    requests.add(task)
                    task.add_done_callback(requests.discard)
        finally:
            self._sockets.discard(response)
            for task in (streaming, *requests):
                self._cancel(task)
        return response

    def _cancel(self, task: asyncio.Task[None]) -> None:
        """Cancel a task until it is done: before Python 3.12, `wait_for` may swallow it once."""
        if not task.done():
            task.cancel()
            self._loop.call_later(_CANCEL_INTERVAL, self._cancel, task)

    async def _stream(self, browser: Browser, response: web.WebSocketResponse) -> None:
        """Stream to a browser; after an error it has to reconnect."""
        assert self._bridge is not None
        try:
            await self._bridge.welcome(browser)
        except Exception:
            _LOG.exception(
                "the connection to a browser is closed after an error; the browser reconnects"
            )
            await response.close(code=1011)


async def _end_tasks() -> None:
    """End all other tasks of the event loop, which is about to be closed."""
    for _ in range(_CANCELLATIONS):
        others = asyncio.all_tasks() - {asyncio.current_task()}
        if not others:
            return
        for task in others:
            task.cancel()
        await asyncio.wait(others, timeout=_CANCEL_INTERVAL)


def _read(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None
