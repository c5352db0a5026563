"""The console in a thread, and pages of it in a real headless Chromium."""

import json
import time
from urllib.parse import urlsplit

import pytest
from console_pages import stamp_at
from geometry_msgs.msg import PointStamped, PolygonStamped
from nodes import overrides

pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")

from pf_tracker_ros.node.console import target_requester, tracker_services
from pf_tracker_ros.node.console.console_node import ConsoleNode
from pf_tracker_ros.tracking.frame_clock import DEFAULT_FROZEN_AFTER

PAGE_DEADLINE = 60_000.0
POLL = 20.0
FIRST_TIMEOUT = 0.25
WITH_BOX = ("tracking", "occluded")


@pytest.fixture
def start_console(graph):
    """A function that starts a console on a free port and returns its node."""

    def start(**parameters):
        given = overrides({"port": 0} | parameters)
        node = ConsoleNode(context=graph.context(), parameter_overrides=given)
        if node.context.ok():
            graph.run(node)
        else:
            node.destroy_node()
        return node

    return start


@pytest.fixture
def short_discovery(monkeypatch):
    """Consoles wait for missing topics and services for half a second."""
    for module in (target_requester, tracker_services):
        monkeypatch.setattr(module, "_DISCOVERY_TICKS", 5)


@pytest.fixture
def tracker(graph, client):
    """A tracker in a thread, with its defaults; before the console, to shorten the discovery."""
    return graph.tracker(client, frozen_after=DEFAULT_FROZEN_AFTER)


@pytest.fixture
def console(start_console):
    """A console of the tracker `pf_tracker`."""
    return start_console()


@pytest.fixture
def sent(tracker, console, client):
    """Targets and clicks that the console sends to the tracker."""
    messages = []
    client.create_subscription(PolygonStamped, "pf_tracker/target", messages.append, 10)
    client.create_subscription(PointStamped, "pf_tracker/click", messages.append, 10)
    senders = [one for one in console.publishers if one.topic.endswith(("/target", "/click"))]
    assert len(senders) == 2

    def are_discovered():
        # By the tracker and by this client; earlier messages are lost.
        return all(sender.get_subscription_count() == 2 for sender in senders)

    client.wait_for(are_discovered, "subscriptions")
    return messages


class Page:
    """A page of the console.

    Attributes:
        page: Playwright's page.
        complaints: Messages in the browser's console, and requests to other hosts.
    """

    def __init__(self, context, url):
        self.context = context
        self.page = context.new_page()
        self.complaints = []
        self._own = urlsplit(url).netloc
        self.page.set_default_timeout(PAGE_DEADLINE)
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", self._on_request)
        self.page.goto(url)

    def _on_request(self, request):
        parts = urlsplit(request.url)
        if parts.scheme in ("http", "https", "ws", "wss") and parts.netloc != self._own:
            self.complaints.append(f"request to {request.url}")

    def __getattr__(self, name):
        return getattr(self.page, name)

    @property
    def stamp(self):
        """Of the displayed frame; 0 before the first."""
        return int(self.page.locator("#overlay").get_attribute("data-stamp") or 0)

    @property
    def has_results(self):
        """Whether the displayed frame has the tracker's results."""
        state = self.page.locator("#overlay").get_attribute("data-state")
        return bool(state) and (state not in WITH_BOX or self.box is not None)

    def shows(self, stamp):
        """Whether the frame of a stamp is displayed with its results."""
        return self.stamp == stamp and self.has_results

    def at_frame(self, index):
        """Wait for a frame of a recording."""
        self.wait_until(lambda: self.shows(stamp_at(index)), f"frame {index}")

    @property
    def box(self):
        """The displayed box [x, y, width, height], None without one."""
        return json.loads(self.page.locator("#overlay").get_attribute("data-box") or "null")

    def wait_until(self, condition, what):
        """Wait until a condition holds, and return its value."""
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        while not (result := condition()):
            assert time.monotonic() < end, f"no {what}; the page says: {self.text('note')}"
            self.page.wait_for_timeout(POLL)
        return result

    def wait_for_text(self, name, text):
        """Wait until the text of an element contains another one."""
        self.wait_until(lambda: text in self.text(name), text)

    def show_more(self):
        """Unfold what is used less often: the drawn box in figures, and the target file."""
        self.page.locator("#more-button[aria-expanded=false]").click()

    def text(self, name):
        return self.page.locator(f"#{name}").inner_text()

    def to_screen(self, x, y):
        """Position of a pixel of the picture on the page."""
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

    def draw(self, wanted):
        """Drag a box, and return the box that the page has sent, as the tracker shows it."""
        self.drag(wanted)
        self.wait_for_text("note", "accepted")

        def shown():
            # Not the box of an earlier target.
            box = self.box
            return box if box == pytest.approx(wanted, abs=1.0) else None

        return tuple(self.wait_until(shown, "box"))


@pytest.fixture
def open_page(browser):
    """A function that opens a console's page; a complaint of any fails the test."""
    contexts, pages = [], []

    def open_one(url, *, may_complain=False, **options):
        context = browser.new_context(**options)
        contexts.append(context)
        page = Page(context, url)
        if not may_complain:
            pages.append(page)
            # Requests before the connection are lost.
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


@pytest.fixture
def write_images(tmp_path, write_bag, make_stamped):
    """A function that writes images, stamped by a function of their index, into the bag `drive`."""
    kind = "sensor_msgs/msg/Image"

    def write(images, stamp_at):
        rows = []
        for index, image in enumerate(images):
            height, width = image.shape[:2]
            fields = {"height": height, "width": width, "encoding": "bgr8", "is_bigendian": 0}
            message = make_stamped(
                kind, stamp_at(index), step=image.strides[0], data=image.reshape(-1), **fields
            )
            rows.append(("/image", kind, stamp_at(index), message))
        return write_bag(tmp_path / "drive", rows)

    return write


@pytest.fixture
def bag(write_images, moving_square):
    """The moving square as a bag: 20 frames at 25 Hz."""
    return write_images(moving_square.images, stamp_at)


@pytest.fixture
def player(tracker, start_console, open_page, bag):
    """A page with the recording at its first frame."""
    page = open_page(start_console(source=str(bag)).url)
    page.at_frame(0)
    page.wait_until(lambda: page.text("frame") == "0 / 19", "position")
    # The services may be discovered later than the images.
    page.locator("#groups details").first.wait_for(state="attached")
    return page


class Camera:
    """Publishes frames of the moving square, and waits for the status of each.

    Attributes:
        images: Of the sequence.
        boxes: Of the square in each image.
        index: Of the next frame; the images go back and forth, the stamps forth.
        shown: (stamp, index in the sequence) of each frame so far.
    """

    def __init__(self, client, sequence):
        self._client = client
        self.images = sequence.images
        self.boxes = sequence.boxes
        self.index = 0
        self.shown = []

    def box_at(self, stamp):
        """Box of the square in the frame of a stamp."""
        return self.boxes[dict(self.shown)[stamp]]

    def show(self):
        """Publish the next frame, and return its status."""
        count = len(self.images)
        turn = self.index % (2 * count - 2)
        place = turn if turn < count else 2 * count - 2 - turn
        stamp = self._client.at(self.index)
        self.index += 1
        self.shown.append((stamp, place))
        return self._client.show(self.images[place], stamp)

    def show_until(self, condition, what):
        """Publish frames until a condition holds, and return its value."""
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        while not (result := condition()):
            assert time.monotonic() < end, f"no {what}"
            self.show()
        return result

    def start_target(self, page):
        """Draw the square on a page, and publish frames until it shows its box."""
        self.show_on(page)
        page.drag(self.box_at(page.stamp))
        self.show_until(lambda: page.box, "box")

    def show_on(self, *pages):
        """Publish frames until all pages display one with its results, and return its status.

        Frames may be lost while the console discovers the camera.
        """
        end = time.monotonic() + PAGE_DEADLINE / 1e3
        timeout = FIRST_TIMEOUT
        while True:
            status = self.show()
            again = time.monotonic() + timeout
            while time.monotonic() < again:
                if all(page.shows(status.stamp) for page in pages):
                    return status
                pages[0].wait_for_timeout(POLL)
            # The machine may be busy.
            timeout *= 2.0
            assert time.monotonic() < end, "the pages do not show the camera's frames"


@pytest.fixture
def camera(tracker, client, moving_square):
    """A camera with the moving square, and a tracker."""
    return Camera(client, moving_square)


@pytest.fixture
def shown(tracker, camera, page):
    """A page with the camera's pictures, and a tracker without a target."""
    status = camera.show_on(page)
    assert status.values["state"] == "idle"
    assert page.size == (160, 120)
    return page
