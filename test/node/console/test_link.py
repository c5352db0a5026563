"""The page over a link that bears little, and the picture for a window that shows little."""

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
OCTETS_A_SECOND = 5e6 / 8

NOTE_AGES = """() => {
  window.ages = [];
  const overlay = document.querySelector('#overlay');
  new MutationObserver(() => {
    window.ages.push([Date.now(), Date.now() - Number(BigInt(overlay.dataset.stamp) / 1000000n)]);
  }).observe(overlay, { attributes: true, attributeFilter: ['data-stamp'] });
}"""


class SlowLink:
    """A relay to a port of this machine that lets so many octets a second through to its client.

    Attributes:
        url: To be opened in place of the other side's.
    """

    def __init__(self, link, octets_a_second):
        self._port = urlsplit(link).port
        self._rate = octets_a_second
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
                # What waits in buffers would be old when it comes.
                server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16_384)
                server.connect(("127.0.0.1", self._port))
                for ends in ((server, client, self._rate), (client, server, float("inf"))):
                    threading.Thread(target=self._forward, args=ends, daemon=True).start()

    @staticmethod
    def _forward(source, sink, rate):
        with contextlib.suppress(OSError), source, sink:
            free_at = time.monotonic()
            while octets := source.recv(4096):
                free_at = max(free_at, time.monotonic()) + len(octets) / rate
                time.sleep(max(0.0, free_at - time.monotonic()))
                sink.sendall(octets)


@pytest.fixture
def slow_link(console):
    """The console behind 5 Mbit/s."""
    link = SlowLink(console.url, OCTETS_A_SECOND)
    yield link.url
    link.close()


@pytest.fixture
def camera(client):
    """Noise at 30 Hz on this machine's clock, as long as the fixture is there.

    Noise is the worst there is for JPEG: a frame in full detail takes a quarter of a second.
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
    """Of the picture's own pixels."""
    return page.evaluate("() => document.querySelector('#picture').width")


@pytest.mark.usefixtures("camera")
def test_a_narrow_link_drops_detail_and_frames_and_stays_live(slow_link, open_page):
    page = open_page(slow_link)
    page.evaluate(NOTE_AGES)

    def last_seconds():
        ages = page.evaluate("() => window.ages.filter(([time]) => time > Date.now() - 3000)")
        return [age for _, age in ages] if len(ages) > 1 else [math.inf]

    # In full detail, 4 frames a second pass, up to 0.8 s old.
    page.wait_until(
        lambda: len(ages := last_seconds()) > 3 * 6 and max(ages) < 600.0, "live picture"
    )
    quality, width = page.text("jpeg").removesuffix(" px").split(", ")
    assert int(quality) < 80 or int(width) < 768
    # What is told is what the link bears: not more than it lets through.
    rate, unit = page.text("link").split()
    assert unit == "Mbit/s"
    assert 0.0 < float(rate) < 8.0


@pytest.mark.usefixtures("camera")
def test_a_small_window_gets_a_small_picture_and_a_large_one_all_of_it(console, open_page):
    page = open_page(console.url, viewport={"width": 390, "height": 800})
    # The picture is 370 px wide there, and half of the image has 384.
    page.wait_until(lambda: shown_width(page) in range(1, 385), "picture for the window")
    assert page.size == (768, 576)
    page.set_viewport_size({"width": 1400, "height": 1000})
    page.wait_until(lambda: shown_width(page) > 384, "more of the picture")


def test_a_picture_that_stands_still_is_sharp_in_a_window_that_was_made_wider(
    console, open_page, camera
):
    page = open_page(console.url, viewport={"width": 390, "height": 800})
    page.wait_until(lambda: shown_width(page) in range(1, 385), "picture for the window")
    camera()
    page.set_viewport_size({"width": 1400, "height": 1000})
    page.wait_until(lambda: shown_width(page) > 384, "more of the picture, without another frame")
