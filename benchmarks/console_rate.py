"""What the console's page shows of a camera at 30 Hz, and what that costs the tracker.

Camera, tracker, console and a headless Chromium are processes of their own, on the loopback.
Shown is what the page has drawn when its next animation frame begins; the age counts from the
stamp, which the camera takes as it publishes. The slow link is a relay that lets 5 Mbit/s through
to the browser.

    python benchmarks/console_rate.py --seconds 20
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import rclpy
from arguments import at_least
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from frame_loss import SIZES, Camera, moving_noise, play, process
from playwright.sync_api import Browser, sync_playwright

PORT = 8647
RELAY_PORT = 8648
LINK_BYTES = 5e6 / 8
RATE = 30.0
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"]
NOTE_FRAMES = """() => {
  window.ages = [];
  const overlay = document.querySelector('#overlay');
  new MutationObserver(() => {
    const stamp = Number(BigInt(overlay.dataset.stamp) / 1000n) / 1000;
    requestAnimationFrame(() => window.ages.push([Date.now(), Date.now() - stamp]));
  }).observe(overlay, { attributes: true, attributeFilter: ['data-stamp'] });
}"""


class TimedCamera(Camera):
    """Notes how long the tracker takes, too.

    Attributes:
        times: Milliseconds a frame.
    """

    def __init__(self) -> None:
        super().__init__("reliable")
        self.times: list[float] = []
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, 1000)

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for item in message.status[0].values}
        self.times.append(float(values["processing_time_ms"]))


@contextmanager
def relay() -> Iterator[None]:
    """A slow link to the console, as long as it is open."""
    server = socket.create_server(("127.0.0.1", RELAY_PORT))

    def forward(source: socket.socket, sink: socket.socket, rate: float) -> None:
        with contextlib.suppress(OSError), source, sink:
            while octets := source.recv(4096):
                time.sleep(len(octets) / rate)
                sink.sendall(octets)

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                browser, _ = server.accept()
                console = socket.socket()
                # What waits in buffers is old when it comes.
                console.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16_384)
                console.connect(("127.0.0.1", PORT))
                for ends in ((console, browser, LINK_BYTES), (browser, console, 1e9)):
                    threading.Thread(target=forward, args=ends, daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield
    finally:
        server.close()


@contextmanager
def page_of(browser: Browser, port: int) -> Iterator[Any]:
    """A page of the console that notes when it has drawn what."""
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{port}/")
    page.evaluate(NOTE_FRAMES)
    yield page
    page.close()


def measure(size: str, seconds: float, page: Any) -> str:
    """One row: what the tracker did, and what the page has shown."""
    camera = TimedCamera()
    figures = play(camera, moving_noise(*SIZES[size]), RATE, seconds)
    camera.destroy_node()  # type: ignore[no-untyped-call]
    times = np.array(camera.times[len(camera.times) // 5 :])
    ages = 1e3 * np.array(figures.ages)
    row = (
        f"{len(figures.ages) / figures.published:.1%} | {np.median(times):.1f} / "
        f"{np.percentile(times, 99):.1f} | {np.median(ages):.0f} / {np.percentile(ages, 99):.0f}"
    )
    if page is None:
        return f"{row} | - | -"
    shown = np.array(page.evaluate("() => window.ages"), np.float64)
    shown = shown[shown[:, 0] > shown[-1, 0] - 1e3 * seconds]
    rate = (len(shown) - 1) / (shown[-1, 0] - shown[0, 0]) * 1e3
    return (
        f"{row} | {rate:.1f} | {np.median(shown[:, 1]):.0f} / {np.percentile(shown[:, 1], 99):.0f}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table.

    Args:
        arguments: Command line without the program's name; None takes the process'.
    """
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--seconds", type=at_least(1), default=20)
    parser.add_argument("--size", choices=SIZES, default="768x576")
    given = parser.parse_args(arguments)
    chromium = shutil.which("chromium") or parser.error("needs Chromium: apt install chromium")
    columns = "answered | processing (ms) | answer's age (ms) | shown a second | age shown (ms)"
    print(f"| median / 99 % | {columns} |")
    print("|---|---|---|---|---|---|")
    with domain_id() as domain, contextlib.ExitStack() as stack:
        os.environ |= {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        box = "target_box:=[100.0, 100.0, 40.0, 40.0]"
        tracker = "pf_tracker_ros.node.tracker.tracker_node"
        stack.enter_context(
            process("-m", tracker, "--ros-args", "-p", box, "-p", "time_jump:=keep")
        )
        rclpy.init()
        print(f"| no console | {measure(given.size, given.seconds, None)} |", flush=True)
        console = "pf_tracker_ros.node.console.console_node"
        stack.enter_context(process("-m", console, "--ros-args", "-p", f"port:={PORT}"))
        print(f"| no browser | {measure(given.size, given.seconds, None)} |", flush=True)
        driver = stack.enter_context(sync_playwright())
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        stack.enter_context(relay())
        for name, port in (("a browser", PORT), ("a browser at 5 Mbit/s", RELAY_PORT)):
            with page_of(browser, port) as page:
                print(f"| {name} | {measure(given.size, given.seconds, page)} |", flush=True)
        print(f"| no browser | {measure(given.size, given.seconds, None)} |", flush=True)
        browser.close()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
