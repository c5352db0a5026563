"""The web server without a browser."""

import asyncio
import contextlib
import gc
import http.client
import re
import socket
import subprocess
import sys
import threading
from urllib.parse import urlsplit

import aiohttp
import pytest
from console_pages import run_apart

from pf_tracker_ros.node.console import browsers, web_server
from pf_tracker_ros.pages.access import HEADERS

DEADLINE = 60.0

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.fixture
def ask():
    """A function that sends one request and returns status, headers and body."""
    connections = []

    def send(link, path="/", method="GET", **headers):
        parts = urlsplit(link)
        connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=DEADLINE)
        connections.append(connection)
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, headers=names)
        response = connection.getresponse()
        body = b"" if response.status == 101 else response.read()
        return response.status, dict(response.getheaders()), body.decode()

    yield send
    for connection in connections:
        connection.close()


def test_the_page_and_its_parts_are_served_with_the_policy(console, ask):
    status, headers, body = ask(console.url)
    assert status == 200
    assert headers.items() >= HEADERS.items()
    for path in set(re.findall(r'(?:src|href)="([^"]+)"', body)) - {"/tracker.yaml"}:
        status, headers, _ = ask(console.url, path)
        assert status == 200
        assert headers.items() >= HEADERS.items()
        assert headers["Content-Type"].split(";")[0] != "application/octet-stream"


def test_there_is_no_parameter_file_before_the_parameters_are_known(console, ask):
    status, headers, body = ask(console.url, "/tracker.yaml")
    assert (status, body) == (503, "the tracker's parameters are not known yet")
    assert headers.items() >= HEADERS.items()


def test_nothing_else_is_served(console, ask):
    for path in ("/index.html", "/../access.py", "/%2e%2e/access.py", "/page/", "/.env"):
        status, headers, _ = ask(console.url, path)
        assert status == 404
        assert headers.items() >= HEADERS.items()
    for method in ("POST", "PUT", "DELETE"):
        assert ask(console.url, "/", method)[0] == 405


def test_a_socket_is_for_pages_of_the_same_origin(console, ask):
    netloc = urlsplit(console.url).netloc
    assert ask(console.url, "/socket", Origin=f"http://{netloc}", **UPGRADE)[0] == 101
    for origin in ("http://attacker.example", "null", "http://127.0.0.1:1"):
        status, _, text = ask(console.url, "/socket", Origin=origin, **UPGRADE)
        assert status == 403
        assert origin in text
    assert ask(console.url, "/socket", **UPGRADE)[0] == 403


def test_dns_rebinding_is_refused(console, ask):
    port = urlsplit(console.url).port
    host = f"attacker.example:{port}"
    for path, more in (("/", {}), ("/socket", UPGRADE | {"Origin": f"http://{host}"})):
        status, _, text = ask(console.url, path, Host=host, **more)
        assert status == 403
        assert "not served under the name" in text


def test_beyond_the_loopback_a_token_is_required(start_console, ask):
    console = start_console(host="0.0.0.0")
    assert urlsplit(console.url).hostname == socket.gethostname().lower()
    token = urlsplit(console.url).query
    link = f"http://127.0.0.1:{urlsplit(console.url).port}/"
    origin = {"Origin": link.strip("/")}
    for path in ("/", "/console.js", "/?token=wrong", "/?token="):
        status, _, text = ask(link, path)
        assert status == 401
        assert "access token" in text
    assert ask(link, "/socket", **UPGRADE, **origin)[0] == 401

    status, headers, _ = ask(link, f"/?{token}")
    assert status == 303
    assert headers["Location"] == "/"
    assert "HttpOnly" in headers["Set-Cookie"]
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert ask(link, "/", Cookie=cookie)[0] == 200
    assert ask(link, "/socket", Cookie=cookie, **UPGRADE, **origin)[0] == 101
    # The token alone is not enough for a page of another origin.
    more = UPGRADE | {"Origin": "http://attacker.example"}
    assert ask(link, "/socket", Cookie=cookie, **more)[0] == 403


def test_the_token_is_on_the_terminal_once_with_a_warning(ros_domain):
    process = subprocess.Popen(
        [sys.executable, "-m", "pf_tracker_ros.node.console.console_node"]
        + ["--ros-args", "-p", "port:=0", "-p", "host:=0.0.0.0"],
        stderr=subprocess.PIPE,
        text=True,
    )
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "not encrypted" in line:
            break
    process.terminate()
    lines += process.stderr.readlines()
    process.stderr.close()
    assert process.wait(DEADLINE) == 0
    assert len(re.findall(r"\?token=[\w-]{32,}", "".join(lines))) == 1


class Bridge:
    """Welcomes browsers by a function."""

    def __init__(self, welcome):
        self.welcome = welcome
        self.is_closed = False

    async def run(self):
        await asyncio.Event().wait()

    def close(self):
        self.is_closed = True


def test_the_end_does_not_wait_for_slow_browsers_and_leaves_no_task(caplog):
    welcomed = threading.Semaphore(0)

    async def send_more_than_a_browser_takes(browser):
        sending = asyncio.ensure_future(browser.send_bytes(bytes(2 * 10**7)))
        while browser._transport.get_write_buffer_size() < 10**6:
            await asyncio.sleep(0.01)
        welcomed.release()
        await sending

    bridge = Bridge(send_more_than_a_browser_takes)
    server = web_server.WebServer("127.0.0.1", 0, lambda: bridge)
    server.start()
    netloc = urlsplit(server.url).netloc
    lines = [f"{name}: {value}" for name, value in UPGRADE.items()]
    lines = ["GET /socket HTTP/1.1", f"Host: {netloc}", f"Origin: http://{netloc}", *lines]
    request = "\r\n".join([*lines, "", ""]).encode()
    with contextlib.ExitStack() as stack:
        for _ in range(8):
            browser = stack.enter_context(socket.create_connection(("127.0.0.1", server._port)))
            browser.sendall(request)
            assert welcomed.acquire(timeout=DEADLINE)
        server.close()
    gc.collect()
    assert bridge.is_closed
    assert caplog.text == ""


def test_a_port_in_use_is_reported(start_console, console, graph, capfd):
    port = urlsplit(console.url).port
    other = start_console(port=port)
    assert other.exit_code == 1
    assert other.url == ""
    assert f"cannot be served on 127.0.0.1:{port}" in capfd.readouterr().err


def test_an_invalid_parameter_is_reported(start_console, capfd):
    assert start_console(port=70_000).exit_code == 1
    assert "'port'" in capfd.readouterr().err


def test_a_connection_that_accepts_no_data_is_aborted(monkeypatch):
    monkeypatch.setattr(browsers, "_SEND_TIMEOUT", 0.05)
    aborted = []

    class Asleep:
        async def send_str(self, text):
            await asyncio.Event().wait()

        send_bytes = send_str

    class Transport:
        def abort(self):
            aborted.append(True)

    async def send():
        browser = browsers.Browser(Asleep(), Transport())
        await asyncio.gather(browser.send_json({}), browser.send_bytes(b""))

    run_apart(send())
    assert aborted == [True, True]


@pytest.mark.parametrize(("address", "is_local"), [("127.0.0.1", True), ("127.0.0.2", False)])
def test_a_browser_with_the_address_of_the_console_is_local(address, is_local):
    async def connect():
        found = asyncio.get_running_loop().create_future()

        def take(_, writer):
            found.set_result(browsers.Browser(None, writer.transport).is_local)
            writer.close()

        async with await asyncio.start_server(take, "127.0.0.1", 0) as server:
            _, port = server.sockets[0].getsockname()
            _, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(address, 0))
            writer.close()
            return await found

    assert run_apart(connect()) is is_local


def test_a_browser_without_a_transport_is_not_local():
    assert not browsers.Browser(None, None).is_local


def test_a_stream_ends_even_if_its_first_cancellation_is_swallowed():
    ends, canceled = [], threading.Event()

    async def swallow(browser):
        """As `wait_for` may before Python 3.12."""
        await browser.send_json({})
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.Event().wait()
        ends.append("swallowed")
        try:
            await asyncio.Event().wait()
        finally:
            ends.append("canceled")
            canceled.set()

    server = web_server.WebServer("127.0.0.1", 0, lambda: Bridge(swallow))
    server.start()

    async def visit():
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{server.url}socket", origin=server.url.rstrip("/")) as page,
        ):
            await page.receive()

    run_apart(visit())
    assert canceled.wait(DEADLINE)
    server.close()
    assert ends == ["swallowed", "canceled"]
