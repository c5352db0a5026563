"""The timeline of the states, and looking back at earlier frames."""

import pytest
from console_pages import WATCH_MESSAGES


@pytest.fixture
def played(player, moving_square):
    """A page with a recording that was played to its end, with a target from its first frame on."""
    player.boxes = {0: list(player.draw(moving_square.boxes[0]))}
    for index in range(1, 20):
        player.keyboard.press("n")
        player.at_frame(index)
        player.boxes[index] = player.box
    return player


@pytest.fixture
def requests(played):
    """The types of the messages that the page sends from now on."""
    played.evaluate(WATCH_MESSAGES)
    return lambda: [
        one["type"] for one in played.evaluate("() => window.sent") if one["type"] != "frame_ack"
    ]


def at_frame(page, index):
    page.at_frame(index)
    page.wait_until(lambda: page.text("frame") == f"{index} / 19", "its number")


def click_at(page, index, count=20):
    area = page.locator("#timeline").bounding_box()
    x = area["x"] + (index + 0.5) / count * area["width"]
    page.mouse.click(x, area["y"] + area["height"] / 2)


def test_earlier_frames_are_shown_as_they_were_without_tracking_them_again(played, requests):
    for index in (18, 17, 16):
        played.keyboard.press("ArrowLeft")
        at_frame(played, index)
        assert played.box == played.boxes[index]
    assert played.locator("#past").is_visible()
    assert played.text("moment").startswith("frame 16, 0:00.6: 1 · tracking ")
    played.keyboard.press("n")
    at_frame(played, 17)
    played.keyboard.press("Escape")
    at_frame(played, 19)
    assert played.locator("#past").is_hidden()
    # By a click on the timeline.
    click_at(played, 5)
    at_frame(played, 5)
    assert played.box == played.boxes[5]
    timeline = played.locator("#timeline")
    played.wait_until(lambda: timeline.get_attribute("aria-valuenow") == "5", "its position")
    played.locator("#now").click()
    at_frame(played, 19)
    # By its keys.
    timeline.focus()
    for key, index in (("ArrowLeft", 18), ("Home", 0), ("ArrowRight", 1), ("End", 19)):
        timeline.press(key)
        at_frame(played, index)
    timeline.press("PageDown")
    at_frame(played, 0)
    played.keyboard.press("Escape")
    at_frame(played, 19)
    assert requests() == []
    # A new page knows the time of its first frame.
    played.reload()
    at_frame(played, 19)
    ticks = played.locator("#ticks span")
    played.wait_until(lambda: ticks.last.inner_text() == "0:00.8", "time axis")


def test_it_is_tracked_again_from_the_frame_that_is_looked_at(played, requests):
    click_at(played, 7)
    at_frame(played, 7)
    assert played.text("again") == "Track again from here"
    played.locator("#again").click()
    played.wait_until(lambda: played.locator("#past").is_hidden(), "newest frame")
    at_frame(played, 7)
    played.wait_until(lambda: played.box == pytest.approx(played.boxes[7], abs=2e-3), "its box")
    assert requests() == ["seek"]
    # What came after it in the earlier run is no longer known.
    click_at(played, 12)
    at_frame(played, 12)
    assert played.box == pytest.approx(played.boxes[12], abs=2e-3)
    assert played.locator("#past").is_hidden()
    assert requests() == ["seek", "seek"]
    # Played on from a frame that is looked at, it does not jump to the newest one.
    click_at(played, 3)
    at_frame(played, 3)
    played.keyboard.press("Space")
    played.wait_until(lambda: played.text("play-word") == "Pause", "that it plays")
    at_frame(played, 19)
    assert played.box == pytest.approx(played.boxes[19], abs=2e-3)


def test_a_target_is_drawn_on_the_frame_that_is_looked_at(played, moving_square):
    click_at(played, 4)
    at_frame(played, 4)
    played.drag(moving_square.boxes[4])
    played.wait_until(lambda: played.locator("#past").is_hidden(), "newest frame")
    at_frame(played, 4)
    played.wait_until(
        lambda: played.box == pytest.approx(moving_square.boxes[4], abs=1.0), "its box"
    )


def test_the_states_are_drawn_in_their_colors_over_the_whole_recording(played):
    def painted():
        """Shares of the timeline's columns that are painted, and that are green."""
        return played.evaluate(
            """() => {
              const canvas = document.querySelector("#states"), { width, height } = canvas;
              const copy = new OffscreenCanvas(width, height)
                .getContext("2d", { willReadFrequently: true });
              copy.drawImage(canvas, 0, 0);
              const pixels = copy.getImageData(0, 0, width, height).data;
              const bottom = [...Array(width).keys()].map(x => 4 * ((height - 2) * width + x));
              const filled = bottom.filter(i => pixels[i + 3] > 0);
              const green = filled.filter(i => pixels[i + 1] > 1.5 * pixels[i]);
              return [filled.length / width, green.length / width];
            }"""
        )

    played.wait_until(lambda: painted()[0] > 0.99, "the whole recording")
    assert painted()[1] > 0.9
    texts = played.locator("#ticks span").all_inner_texts()
    assert texts == ["0:00", "0:00.2", "0:00.4", "0:00.6", "0:00.8"]
    # The target is gone from then on, and its color with it.
    played.keyboard.press("Home")
    at_frame(played, 0)
    played.wait_until(lambda: painted()[0] < 0.1, "the new run")


def test_where_a_detector_starts_the_targets_a_missing_frame_is_stepped_over(played, client):
    """A seek would stop the targets, and the detector would start others later."""

    def lose(message):
        if isinstance(message, bytes) and b'"index": 10,' in message:
            # Acknowledged, so that the next ones come.
            server.send('{"type": "frame_ack"}')
        else:
            route.send(message)

    def connect(socket):
        nonlocal route, server
        route, server = socket, socket.connect_to_server()
        server.on_message(lose)

    route = server = None
    played.route_web_socket("**/socket", connect)
    played.reload()
    client.set_parameters(built_in_detector="motion")
    choice = played.locator("[id='parameter-built_in_detector']")
    played.wait_until(lambda: choice.count() and choice.input_value() == "motion", "detector")
    played.locator("#seek").fill("8")
    played.locator("#seek").blur()
    at_frame(played, 8)
    for index in (9, 11):
        played.keyboard.press("n")
        if index == 11:
            played.keyboard.press("n")
        at_frame(played, index)
    played.keyboard.press("ArrowLeft")
    at_frame(played, 9)
    assert played.text("again") == "Track again from here (forgets detected targets)"
    played.keyboard.press("ArrowRight")
    at_frame(played, 11)
    assert played.locator("#past").is_hidden()


def test_a_camera_is_looked_back_at_while_it_goes_on(camera, page):
    camera.show_on(page)
    assert page.text("states-empty") == "Waits for a target: its states over time"
    camera.start_target(page)
    seen = {}
    for _ in range(6):
        camera.show_on(page)
        seen[page.stamp] = page.box
    timeline = page.locator("#timeline")
    timeline.focus()
    for stamp in [*seen][-2:-5:-1]:
        timeline.press("ArrowLeft")
        page.wait_until(lambda: page.stamp == stamp, "frame before")  # noqa: B023
        assert page.box == seen[stamp]
    assert "1 · tracking" in page.text("moment")
    # The camera goes on, and the picture stays.
    last = camera.show().stamp
    page.wait_until(lambda: page.locator("#ticks span").last.inner_text() == "now", "axis")
    assert page.stamp == stamp
    page.keyboard.press("Escape")
    page.wait_until(lambda: page.stamp >= last, "newest frame")
    camera.show_on(page)
