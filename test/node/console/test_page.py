"""The page's display, and its recovery where tracker, images or console are missing."""

import contextlib
import itertools
import random
import signal
import socket

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from pf_tracker_ros.node.console import bridge
from pf_tracker_ros.stamps import stamp_of

HOSTILE = "<img src=x onerror=alert(1)>&amp;<script>alert(2)</script>"
# WCAG 2, level AA: of text below 24 px.
LEAST_CONTRAST = 4.5

CONTRASTS = """() => {
  const numbers = color => color.match(/[\\d.]+/g).map(Number);
  const luminance = ([r, g, b]) => [r, g, b]
    .map(v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = element => {
    for (let e = element; e; e = e.parentElement) {
      const color = numbers(getComputedStyle(e).backgroundColor);
      if (color.length === 3 || color[3] > 0.7) return color;
    }
    return [255, 255, 255];
  };
  return [...document.querySelectorAll('body *')]
    .filter(e => e.checkVisibility())
    .filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()))
    .map(e => {
      const [a, b] = [numbers(getComputedStyle(e).color), ground(e)].map(luminance);
      return [(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), e.textContent.trim().slice(0, 40)];
    });
}"""

SHOW_ALL = """() => {
  for (const id of ["recording", "tour", "steps", "hint", "files", "past"])
    document.getElementById(id).hidden = false;
}"""

SHAPES = "paths => paths.map(path => path.getAttribute('d') || '')"

SEE_FRAMES = """() => {
  window.seen = [];
  const overlay = document.querySelector('#overlay');
  new MutationObserver(() => {
    const { stamp, box } = overlay.dataset;
    if (window.seen.at(-1)?.[0] !== stamp) window.seen.push([stamp, JSON.parse(box)]);
  }).observe(overlay, { attributes: true, attributeFilter: ['data-box', 'data-stamp'] });
}"""


@pytest.fixture
def bag(write_images, moving_square):
    """A bag of 300 frames at 30 Hz, in which the square moves back and forth."""
    images = moving_square.images
    order = itertools.cycle([*images, *images[-2:0:-1]])
    return write_images(
        itertools.islice(order, 300), lambda index: 1_700_000_000_000_000_000 + index * 33_333_333
    )


@pytest.mark.usefixtures("tracker")
def test_the_overlay_follows_a_replayed_bag_with_the_box_of_the_same_stamp(
    graph, client, page, bag, moving_square
):
    page.evaluate(SEE_FRAMES)
    box = [float(value) for value in moving_square.boxes[0]]
    graph.process(
        *("-p", f"source:={bag}", "-p", "rate:=0.5", "-p", f"target_box:={box}"),
        module="pf_tracker_ros.node.replay.replay_node",
    )
    client.wait_for(
        lambda: page.evaluate("() => window.seen.filter(([, box]) => box).length") >= 80,
        "frames on the page",
        120.0,
    )
    seen = [(int(stamp), box) for stamp, box in page.evaluate("() => window.seen") if box]
    client.box_at(seen[-1][0])
    published = {stamp_of(m.header): [(p.x, p.y) for p in m.polygon.points] for m in client.boxes}
    for stamp, (x, y, width, height) in seen:
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        assert np.allclose(published[stamp], corners, atol=2e-3), stamp
    assert len({tuple(box) for _, box in seen}) > 50


def test_the_state_and_its_figures_are_those_of_the_status(camera, page):
    camera.start_target(page)
    status = camera.show_on(page)
    assert page.text("state") == status.values["state"]
    # Figures change a few times a second.
    confidence = f"{100 * float(status.values['confidence']):.0f} %"
    page.wait_until(lambda: page.text("confidence") == confidence, "its confidence")
    page.wait_until(lambda: page.text("count") == status.values["particles"], "its particles")
    particles = page.locator("#particles")
    page.wait_until(lambda: particles.get_attribute("d").count("M") == 200, "every particle")
    assert page.locator("#covariance:not([hidden])").count() == 1
    assert len(page.locator("#trail").get_attribute("points").split()) > 1


def test_the_last_minute_of_the_figures_is_drawn(camera, page, client):
    camera.start_target(page)
    confidence, cue_weights = (
        page.locator(f"#plot-{name} path") for name in ("confidence", "weights")
    )

    def is_line_long():
        # No locator may wait for the line here, as new frames draw it.
        return any(len(path.split("L")) > 10 for path in confidence.evaluate_all(SHAPES))

    camera.show_until(is_line_long, "line")
    # The default preset has two cues.
    camera.show_until(lambda: cue_weights.count() == 2, "line for each cue")
    camera.show_until(lambda: page.locator("#cues li").count() == 2, "weight of each cue")
    legend = page.locator("#cues li")
    weights = [float(text.split()[-2]) for text in legend.all_inner_texts()]
    assert sum(weights) == pytest.approx(100.0, abs=2.0)
    # The line of a removed cue stays for a minute, without a weight.
    client.set_parameters(cues=["correlation_response"])
    camera.show_until(
        lambda: legend.all_inner_texts() == ["color contrast \u2013", "correlation response 100 %"],
        "weight of the only cue",
    )


def test_the_heat_map_is_shown_on_demand(tracker, camera, page):
    (publisher,) = [one for one in tracker.publishers if one.topic.endswith("/likelihood")]
    camera.start_target(page)
    assert publisher.get_subscription_count() == 0
    page.keyboard.press("h")
    camera.show_until(page.locator("#heatmap").is_visible, "the heat map")
    camera.show_on(page)
    page.wait_until(page.locator("#heatmap").is_visible, "the heat map of this frame")
    area, (x, y, width, height) = page.locator("#heatmap").bounding_box(), page.box
    middle = page.to_screen(x + width / 2, y + height / 2)
    found = area["x"] + area["width"] / 2, area["y"] + area["height"] / 2
    assert found == pytest.approx(middle, abs=2.0)
    assert "color contrast: target 1.00, second peak 0." in page.locator("#bars").inner_text()
    page.keyboard.press("h")
    assert page.locator("#heatmap").is_hidden()
    camera.show_until(lambda: publisher.get_subscription_count() == 0, "end of the subscription")


def test_two_browsers_see_the_same(camera, console, open_page):
    one, other = open_page(console.url), open_page(console.url)
    camera.show_on(one, other)
    one.drag(camera.box_at(one.stamp))
    camera.show_until(lambda: other.box, "box in the other")
    other.wait_until(lambda: "accepted" in other.text("note"), "news of the other's target")
    camera.show_on(one, other)
    assert one.stamp == other.stamp
    assert one.box == other.box
    other.keyboard.press("s")
    for page in (one, other):
        page.wait_for_text("note", "stopped")


def test_a_missing_tracker_is_reported_and_found_later(page, graph):
    page.wait_for_text("health", "no tracker /pf_tracker")
    assert page.text("state") == "no tracker"
    assert page.locator("#missing").is_visible()
    graph.tracker()
    page.wait_until(lambda: page.text("health").endswith("waiting for a target"), "its words")
    page.wait_until(lambda: page.text("state") == "idle", "its state")


def test_after_a_drawing_error_further_frames_are_shown(tracker, console, camera, open_page):
    page = open_page(console.url, may_complain=True)
    camera.show_on(page)
    page.evaluate(
        """() => {
          const draws = CanvasRenderingContext2D.prototype, draw = draws.drawImage;
          draws.drawImage = () => { draws.drawImage = draw; throw new Error("no memory"); };
        }"""
    )
    camera.show_until(lambda: "no memory" in page.text("note"), "what is wrong")
    for _ in range(3):
        camera.show_on(page)


def test_the_state_is_marked_as_old_when_images_stop(tracker, client, camera, page):
    client.set_parameters(image_timeout=0.5)
    camera.show_on(page)
    page.drag(camera.box_at(page.stamp))
    camera.show_until(lambda: page.text("state") == "tracking", "target")
    card = page.locator("#state-card")
    assert card.get_attribute("data-state") == "tracking"
    page.wait_until(lambda: card.get_attribute("data-state") == "old", "that no image comes")
    assert page.text("state") == "tracking"
    camera.show_on(page)
    assert card.get_attribute("data-state") == "tracking"


def free_port():
    """A port that stays free until it is served on.

    Ports from 32768 on may be taken by outgoing connections, such as a browser's.
    """
    for port in random.SystemRandom().sample(range(10_000, 30_000), 100):
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise AssertionError("no port is free")


@pytest.fixture
def killable(graph, start_console, camera, open_page):
    """(page, console, restart): a page, its console's process, a function that starts another."""
    port = free_port()
    module = "pf_tracker_ros.node.console.console_node"
    console = graph.process("-p", f"port:={port}", module=module)
    while "console of" not in (line := console.stdout.readline()):
        assert line, "the console has ended"
    # The browser's console reports a broken connection.
    page = open_page(f"http://127.0.0.1:{port}/", may_complain=True)
    camera.show_on(page)

    def restart():
        # The port may be in use until the killed console has ended.
        console.wait()
        start_console(port=port)
        page.wait_until(lambda: page.text("connection") == "connected", "the tracker")

    return page, console, restart


def show_until_accepted(page, camera):
    """Show frames until the tracker has accepted the target."""
    page.wait_until(lambda: camera.show() and "accepted" in page.text("note"), "acceptance")


def test_a_box_drawn_without_a_console_can_be_sent_to_the_next(camera, killable):
    page, console, restart = killable
    console.kill()
    page.wait_for_text("connection", "no console")
    page.drag(camera.box_at(page.stamp))
    page.wait_for_text("note", "nothing was sent")
    restart()
    page.keyboard.press("Enter")
    show_until_accepted(page, camera)
    camera.show_on(page)


def test_a_box_without_a_response_can_be_sent_to_the_next_console(camera, killable):
    page, console, restart = killable
    console.send_signal(signal.SIGSTOP)
    box = camera.box_at(page.stamp)
    page.drag(box)
    page.wait_until(lambda: page.text("note").startswith("sent"), "that it was sent")
    console.kill()
    console.wait()
    restart()
    page.wait_for_text("note", "send the box again")
    page.keyboard.press("Enter")
    show_until_accepted(page, camera)
    camera.show_on(page)
    page.wait_until(lambda: page.box, "box")


def test_the_page_adapts_to_a_new_image_size(camera, client, page, images):
    camera.show_on(page)
    assert page.size == (160, 120)
    tall = np.ascontiguousarray(images[0][:, :90])
    client.show_until(lambda status: page.size == (90, 120), [tall], first=1000)
    area = page.locator("#stage").bounding_box()
    assert area["width"] / area["height"] == pytest.approx(0.75, abs=0.02)


def test_the_picture_has_as_many_pixels_as_the_window_needs(console, client, open_page, noise):
    page = open_page(console.url, viewport={"width": 390, "height": 800})
    image, stamps = noise(576, 768), (client.at(index) for index in itertools.count())

    def width():
        return page.evaluate("() => document.querySelector('#picture').width")

    def is_narrow():
        client.images.publish(client.message(image, next(stamps)))
        page.wait_for_timeout(20)
        # The picture has 370 px on the screen, half of the image 384.
        return width() in range(1, 385)

    page.wait_until(is_narrow, "picture for the window")
    assert page.size == (768, 576)
    page.wait_until(lambda: page.text("link").endswith("Mbit/s"), "rate")
    page.set_viewport_size({"width": 1400, "height": 1000})
    page.wait_until(lambda: width() > 384, "more of the picture, without another frame")


class StandIn(Node):
    """A stand-in for the tracker with hostile diagnostics."""

    def __init__(self, context):
        super().__init__("pf_tracker", context=context)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(0.2, self._publish_diagnostics)

    def _publish_diagnostics(self):
        status = DiagnosticStatus(
            name="pf_tracker: tracker",
            level=DiagnosticStatus.ERROR,
            message=HOSTILE,
            values=[
                KeyValue(key=key, value=HOSTILE) for key in ("state", "image_reliability", "preset")
            ],
        )
        self._health.publish(DiagnosticArray(status=[status]))


def test_hostile_names_are_shown_as_text(graph, page):
    graph.run(StandIn(graph.context()))
    page.wait_until(lambda: page.text("health") == HOSTILE, "the text")
    page.wait_until(lambda: page.text("state") == HOSTILE, "the state")
    assert page.locator("img, script:not([src])").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_text_is_readable_and_nothing_is_cut_off(camera, console, open_page, scheme, width):
    page = open_page(console.url, color_scheme=scheme, viewport={"width": width, "height": 800})
    camera.show_on(page)
    page.keyboard.press("r")
    page.show_more()
    # With the parts of a recording, and with each color of the state.
    page.evaluate(SHOW_ALL)
    for state in ("idle", "tracking", "occluded", "lost", "none", "old"):
        page.locator("#state-card").evaluate("(it, state) => { it.dataset.state = state; }", state)
        contrasts = page.evaluate(CONTRASTS)
        assert len(contrasts) > 30
        assert [one for one in contrasts if one[0] < LEAST_CONTRAST] == [], state
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width


def test_without_a_browser_the_console_subscribes_to_nothing(
    tracker, client, start_console, open_page, monkeypatch
):
    # Longer, it only covers a page that is reloaded.
    monkeypatch.setattr(bridge, "_LINGER", 0.5)

    def listeners():
        names = ("box", "boxes", "particles", "status", "overlay", "likelihood")
        return {
            name: publisher.get_subscription_count()
            for publisher in tracker.publishers
            for name in names
            if publisher.topic.endswith(f"/{name}")
        }

    before = listeners()
    console = start_console()
    image_subscribers = client.images.get_subscription_count
    client.wait_for(client.targets.get_subscription_count, "tracker")
    (health,) = [one for one in tracker.publishers if one.topic.endswith("diagnostics")]
    client.wait_for(lambda: health.get_subscription_count() == 2, "console")
    assert (listeners(), image_subscribers()) == (before, 1)
    page = open_page(console.url)
    watched = before | {name: before[name] + 1 for name in ("boxes", "particles", "status")}
    client.wait_for(
        lambda: (listeners(), image_subscribers()) == (watched, 2), "subscriptions for the page"
    )
    page.close()
    client.wait_for(lambda: (listeners(), image_subscribers()) == (before, 1), "end of them")


def test_an_older_frame_never_replaces_a_newer_one(camera, page):
    camera.show_on(page)
    page.evaluate(SEE_FRAMES)
    # Of the next frames, the first takes longest to decode.
    page.evaluate(
        """() => {
          const decode = window.createImageBitmap.bind(window);
          let delay = 900;
          window.createImageBitmap = async (...given) => {
            const mine = delay;
            delay = 0;
            await new Promise(done => setTimeout(done, mine));
            return decode(...given);
          };
        }"""
    )
    last = [camera.show() for _ in range(3)][-1].stamp
    page.wait_until(lambda: page.shows(last), "newest frame")
    page.wait_for_timeout(1000.0)
    assert page.stamp == last
    stamps = [int(stamp) for stamp, _ in page.evaluate("() => window.seen")]
    assert stamps == sorted(stamps)
