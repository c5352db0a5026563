"""Browsers and links to the console's page."""

from __future__ import annotations

import asyncio
import contextlib
import json
import multiprocessing
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.sharedctypes import Synchronized
from typing import Any

import aiohttp
from playwright.sync_api import Browser

LINK_BYTES = 5e6 / 8
# Seconds that a page needs to draw a picture.
DRAWING = 0.02
NOTE_FRAMES = """() => {
  window.ages = [];
  const overlay = document.querySelector('#overlay');
  new MutationObserver(() => {
    const stamp = Number(BigInt(overlay.dataset.stamp) / 1000n) / 1000;
    requestAnimationFrame(() => window.ages.push([Date.now(), Date.now() - stamp]));
  }).observe(overlay, { attributes: true, attributeFilter: ['data-stamp'] });
}"""


@contextmanager
def relay(port: int, console: int) -> Iterator[None]:
    """A relay with 5 Mbit/s from a port to the console's, while the context is open."""
    server = socket.create_server(("127.0.0.1", port))

    def forward(source: socket.socket, sink: socket.socket, rate: float) -> None:
        with contextlib.suppress(OSError), source, sink:
            while data := source.recv(4096):
                time.sleep(len(data) / rate)
                sink.sendall(data)

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                browser, _ = server.accept()
                server_side = socket.socket()
                server_side.bind(("127.0.0.2", 0))
                # A large buffer would add latency.
                server_side.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16_384)
                server_side.connect(("127.0.0.1", console))
                for ends in ((server_side, browser, LINK_BYTES), (browser, server_side, 1e9)):
                    threading.Thread(target=forward, args=ends, daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield
    finally:
        server.close()


def receive_pictures(port: int, count: Synchronized[int]) -> None:
    """Receive, count and acknowledge every picture, without drawing it."""

    async def receive() -> None:
        origin = f"http://127.0.0.1:{port}"
        # Another address than the console's, so that it counts as a remote browser.
        connector = aiohttp.TCPConnector(local_addr=("127.0.0.2", 0))
        async with (
            aiohttp.ClientSession(connector=connector) as session,
            session.ws_connect(f"{origin}/socket", origin=origin) as page,
        ):
            async for message in page:
                if message.type == aiohttp.WSMsgType.BINARY:
                    count.value += 1
                    await asyncio.sleep(DRAWING)
                    await page.send_json({"type": "frame_ack"})
                elif json.loads(message.data)["type"] == "welcome":
                    await page.send_json({"type": "welcome_ack"})
                    await page.send_json({"type": "view", "width": 1280})

    asyncio.run(receive())


@contextmanager
def receiver(port: int) -> Iterator[None]:
    """A browser without drawing, in a process of its own."""
    context = multiprocessing.get_context("spawn")
    count = context.Value("l", 0)
    process = context.Process(target=receive_pictures, args=(port, count))
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()
    if not count.value:
        raise RuntimeError("the console sent no pictures")


@contextmanager
def page_of(browser: Browser, port: int) -> Iterator[Any]:
    """A page of the console that records the time and age of each drawn frame."""
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{port}/")
    page.evaluate(NOTE_FRAMES)
    yield page
    page.close()
