"""The console in a thread, and pages of it in a real headless Chromium."""

import json
import time
from urllib.parse import urlsplit

import pytest
from rclpy.parameter import Parameter

pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")

from pf_tracker_ros.node.console.console_node import ConsoleNode

PAGE_DEADLINE = 60_000.0
POLL = 20.0
FIRST_PATIENCE = 1.0
WITH_BOX = ("tracking", "occluded")


@pytest.fixture
def start_console(graph):
    """A function that starts a console on a free port and returns its node."""

    def start(**parameters):
        overrides = {"port": 0} | parameters
        node = ConsoleNode(
            context=graph.context(),
            parameter_overrides=[Parameter(name, value=value) for name, value in overrides.items()],
        )
        if node.context.ok():
            graph.run(node)
        else:
            node.destroy_node()
        return node

    return start


@pytest.fixture
def tracker(graph, client):
    """A tracker in a thread; before the console, so that client and tracker meet alone."""
    return graph.tracker(client)


@pytest.fixture
def console(start_console):
    """A console of the tracker `pf_tracker`."""
    return start_console()


class Page:
    """One page of the console, and what it complained about.

    Attributes:
        page: As Playwright has it.
        complaints: What the browser's console said, and requests to other hosts.
    """

    def __init__(self, context, link):
        self.context = context
        self.page = context.new_page()
        self.complaints = []
        self._own = urlsplit(link).netloc
        self.page.set_default_timeout(PAGE_DEADLINE)
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", self._on_request)
        self.page.goto(link)

    def _on_request(self, request):
        parts = urlsplit(request.url)
        if parts.scheme in ("http", "https", "ws", "wss") and parts.netloc != self._own:
            self.complaints.append(f"request to {request.url}")

    def __getattr__(self, name):
        return getattr(self.page, name)

    @property
    def stamp(self):
        """Of the frame that is shown; 0 before the first."""
        return int(self.page.locator("#overlay").get_attribute("data-stamp") or 0)

    @property
    def is_answered(self):
        """Whether the shown frame has the tracker's answer; late parts are added to it."""
        state = self.page.locator("#overlay").get_attribute("data-state")
        return bool(state) and (state not in WITH_BOX or self.box is not None)

    def shows(self, stamp):
        """Whether the frame of a stamp is shown, with its answer."""
        return self.stamp == stamp and self.is_answered

    @property
    def box(self):
        """[x, y, width, height] that is drawn over the picture, None without one."""
        return json.loads(self.page.locator("#overlay").get_attribute("data-box") or "null")

    def wait_until(self, condition, what):
        """Let the page go on until something is so, and return it."""
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        while not (result := condition()):
            assert time.monotonic() < end, f"no {what}; the page says: {self.text('note')}"
            self.page.wait_for_timeout(POLL)
        return result

    def text(self, name):
        return self.page.locator(f"#{name}").inner_text()

    def to_screen(self, x, y):
        """Where a pixel of the picture is on the page."""
        area = self.page.locator("#overlay").bounding_box()
        width, height = self.size
        return area["x"] + x * area["width"] / width, area["y"] + y * area["height"] / height

    @property
    def size(self):
        """(width, height) of the picture in its own pixels."""
        view = self.page.locator("#overlay").get_attribute("viewBox").split()
        return float(view[2]), float(view[3])

    def drag(self, box, release=True):
        """Drag a box given in pixels of the picture."""
        x, y, width, height = box
        mouse = self.page.mouse
        mouse.move(*self.to_screen(x, y))
        mouse.down()
        mouse.move(*self.to_screen(x + width / 2, y + height / 2), steps=2)
        mouse.move(*self.to_screen(x + width, y + height))
        if release:
            mouse.up()


@pytest.fixture
def open_page(browser):
    """A function that opens a console's page; at the end, none may have complained."""
    contexts, pages = [], []

    def open_one(link, *, may_complain=False, **options):
        context = browser.new_context(**options)
        contexts.append(context)
        page = Page(context, link)
        if not may_complain:
            pages.append(page)
            # What is asked for before is not sent.
            page.wait_until(lambda: page.text("connection") != "connecting", "connection")
        return page

    yield open_one
    complaints = [page.complaints for page in pages]
    for context in contexts:
        context.close()
    assert complaints == [[] for _ in pages]


@pytest.fixture
def page(console, open_page):
    """A page of the console."""
    return open_page(console.url)


class Camera:
    """Frames of the moving square, one after another, each answered by the tracker.

    Attributes:
        images: Of the sequence.
        boxes: Of the square in each.
        index: Of the next frame; it goes back and forth over the sequence, with stamps that go on.
        shown: (stamp, index in the sequence) of each frame so far.
    """

    def __init__(self, client, sequence):
        self._client = client
        self.images = sequence.images
        self.boxes = sequence.boxes
        self.index = 0
        self.shown = []

    def box_at(self, stamp):
        """Where the square is in the frame of a stamp."""
        return self.boxes[dict(self.shown)[stamp]]

    def show(self):
        """Show the next frame, and return the status that answers it."""
        count = len(self.images)
        turn = self.index % (2 * count - 2)
        place = turn if turn < count else 2 * count - 2 - turn
        stamp = self._client.at(self.index)
        self.index += 1
        self.shown.append((stamp, place))
        return self._client.show(self.images[place], stamp)

    def show_until(self, condition, what):
        """Show frames until something is so, and return it."""
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        while not (result := condition()):
            assert time.monotonic() < end, f"no {what}"
            self.show()
        return result

    def show_on(self, *pages):
        """Show a frame that every one of the pages shows with its answer, and return its status.

        While a console gets to know the camera, frames may be lost on the way to it.
        """
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        patience = FIRST_PATIENCE
        while True:
            status = self.show()
            again = time.monotonic() + patience
            while time.monotonic() < again:
                if all(page.shows(status.stamp) for page in pages):
                    return status
                pages[0].wait_for_timeout(POLL)
            # The machine may be busy.
            patience *= 2.0
            assert time.monotonic() < end, "no page shows what the camera does"


@pytest.fixture
def camera(client, moving_square):
    """A camera that shows the moving square."""
    return Camera(client, moving_square)
