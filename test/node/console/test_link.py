"""The page over a slow link, and in a small window."""

import contextlib
import itertools
import math
import socket
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

# 5 Mbit/s.
BYTES_PER_SECOND = 5e6 / 8

NOTE_AGES = """() => {
  window.ages = [];
  const overlay = document.querySelector('#overlay');
  new MutationObserver(() => {
    window.ages.push([Date.now(), Date.now() - Number(BigInt(overlay.dataset.stamp) / 1000000n)]);
  }).observe(overlay, { attributes: true, attributeFilter: ['data-stamp'] });
}"""


class SlowLink:
    """A relay to a local port with a limited rate towards its client.

    Attributes:
        url: Of the relay.
    """

    def __init__(self, link, bytes_per_second):
        self._port = urlsplit(link).port
        self._rate = bytes_per_second
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._server.getsockname()[1]}/"
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self):
        self._server.close()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._server.accept()
                server = socket.socket()
                # A large buffer would add latency.
                server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16_384)
                server.connect(("127.0.0.1", self._port))
                for ends in ((server, client, self._rate), (client, server, float("inf"))):
                    threading.Thread(target=self._forward, args=ends, daemon=True).start()

    @staticmethod
    def _forward(source, sink, rate):
        with contextlib.suppress(OSError), source, sink:
            free_at = time.monotonic()
            while data := source.recv(4096):
                free_at = max(free_at, time.monotonic()) + len(data) / rate
                time.sleep(max(0.0, free_at - time.monotonic()))
                sink.sendall(data)


@pytest.fixture
def slow_link(console):
    """The console behind 5 Mbit/s."""
    link = SlowLink(console.url, BYTES_PER_SECOND)
    yield link.url
    link.close()


@pytest.fixture
def camera(client):
    """A camera with noise at 30 Hz by this machine's clock; returns the function to stop it.

    Noise is the worst case for JPEG: a frame in full quality takes a quarter of a second.
    """
    generator = np.random.default_rng(0)
    images = generator.integers(0, 255, (4, 576, 768, 3), np.uint8)
    messages = [client.message(image, 0) for image in images]
    stopped = threading.Event()

    def shoot():
        for message in itertools.cycle(messages):
            stamp = time.time_ns()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            client.images.publish(message)
            if stopped.wait(1 / 30):
                return

    thread = threading.Thread(target=shoot)
    thread.start()

    def stop():
        stopped.set()
        thread.join()

    yield stop
    stop()


def shown_width(page):
    """Width of the encoded picture, pixels."""
    return page.evaluate("() => document.querySelector('#picture').width")


@pytest.mark.usefixtures("camera")
def test_on_a_slow_link_quality_and_frames_are_dropped_and_latency_stays_low(slow_link, open_page):
    page = open_page(slow_link)
    page.evaluate(NOTE_AGES)

    def last_seconds():
        ages = page.evaluate("() => window.ages.filter(([time]) => time > Date.now() - 3000)")
        return [age for _, age in ages] if len(ages) > 1 else [math.inf]

    # In full quality it would be 4 frames per second, up to 0.8 s old.
    page.wait_until(
        lambda: len(ages := last_seconds()) > 3 * 6 and max(ages) < 600.0, "live picture"
    )
    quality, width = page.text("jpeg").removesuffix(" px").split(", ")
    assert int(quality) < 80 or int(width) < 768
    # The displayed rate is at most that of the link.
    rate, unit = page.text("link").split()
    assert unit == "Mbit/s"
    assert 0.0 < float(rate) < 8.0


@pytest.mark.usefixtures("camera")
def test_the_picture_has_as_many_pixels_as_the_window_needs(console, open_page):
    page = open_page(console.url, viewport={"width": 390, "height": 800})
    # The picture has 370 px on the screen, half of the image 384.
    page.wait_until(lambda: shown_width(page) in range(1, 385), "picture for the window")
    assert page.size == (768, 576)
    page.set_viewport_size({"width": 1400, "height": 1000})
    page.wait_until(lambda: shown_width(page) > 384, "more of the picture")


def test_a_still_picture_is_sent_again_for_a_wider_window(console, open_page, camera):
    page = open_page(console.url, viewport={"width": 390, "height": 800})
    page.wait_until(lambda: shown_width(page) in range(1, 385), "picture for the window")
    camera()
    page.set_viewport_size({"width": 1400, "height": 1000})
    page.wait_until(lambda: shown_width(page) > 384, "more of the picture, without another frame")
