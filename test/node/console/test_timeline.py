"""The timeline of the states, and looking back at earlier frames."""

import pytest
from console_pages import WATCH_MESSAGES, stamp_at


@pytest.fixture
def player(tracker, start_console, open_page, bag, moving_square):
    """A page with a recording that was played to its end, with a target from its first frame on."""
    page = open_page(start_console(source=str(bag)).url)
    page.wait_until(lambda: page.shows(stamp_at(0)), "first frame")
    page.drag(moving_square.boxes[0])
    page.wait_until(lambda: page.box, "box")
    boxes = {}
    for index in range(20):
        if index:
            page.keyboard.press("n")
        page.wait_until(lambda: page.shows(stamp_at(index)), "next frame")  # noqa: B023
        boxes[index] = page.box
    page.boxes = boxes
    return page


@pytest.fixture
def requests(player):
    """The types of the messages that the page sends from now on."""
    player.evaluate(WATCH_MESSAGES)
    return lambda: [
        one["type"] for one in player.evaluate("() => window.sent") if one["type"] != "frame_ack"
    ]


def at_frame(page, index):
    page.wait_until(lambda: page.shows(stamp_at(index)), f"frame {index}")
    page.wait_until(lambda: page.text("frame") == f"{index} / 19", "its number")


def click_at(page, index, count=20):
    area = page.locator("#timeline").bounding_box()
    x = area["x"] + (index + 0.5) / count * area["width"]
    page.mouse.click(x, area["y"] + area["height"] / 2)


def test_earlier_frames_are_shown_as_they_were_without_tracking_them_again(player, requests):
    for index in (18, 17, 16):
        player.keyboard.press("ArrowLeft")
        at_frame(player, index)
        assert player.box == player.boxes[index]
    assert player.locator("#past").is_visible()
    assert player.text("moment").startswith("frame 16, 0:00.6: 1 · tracking ")
    player.keyboard.press("n")
    at_frame(player, 17)
    player.keyboard.press("Escape")
    at_frame(player, 19)
    assert player.locator("#past").is_hidden()
    # By a click on the timeline.
    click_at(player, 5)
    at_frame(player, 5)
    assert player.box == player.boxes[5]
    timeline = player.locator("#timeline")
    player.wait_until(lambda: timeline.get_attribute("aria-valuenow") == "5", "its position")
    player.locator("#now").click()
    at_frame(player, 19)
    # By its keys.
    timeline.focus()
    for key, index in (("ArrowLeft", 18), ("Home", 0), ("ArrowRight", 1), ("End", 19)):
        timeline.press(key)
        at_frame(player, index)
    timeline.press("PageDown")
    at_frame(player, 0)
    player.keyboard.press("Escape")
    at_frame(player, 19)
    assert requests() == []
    # A new page knows the time of its first frame.
    player.reload()
    at_frame(player, 19)
    ticks = player.locator("#ticks span")
    player.wait_until(lambda: ticks.last.inner_text() == "0:00.8", "time axis")


def test_it_is_tracked_again_from_the_frame_that_is_looked_at(player, requests):
    click_at(player, 7)
    at_frame(player, 7)
    assert player.text("again") == "Track again from here"
    player.locator("#again").click()
    player.wait_until(lambda: player.locator("#past").is_hidden(), "newest frame")
    at_frame(player, 7)
    player.wait_until(lambda: player.box == pytest.approx(player.boxes[7], abs=2e-3), "its box")
    assert requests() == ["seek"]
    # What came after it in the earlier run is no longer known.
    click_at(player, 12)
    at_frame(player, 12)
    assert player.box == pytest.approx(player.boxes[12], abs=2e-3)
    assert player.locator("#past").is_hidden()
    assert requests() == ["seek", "seek"]
    # Played on from a frame that is looked at, it does not jump to the newest one.
    click_at(player, 3)
    at_frame(player, 3)
    player.keyboard.press("Space")
    player.wait_until(lambda: player.text("play-word") == "Pause", "that it plays")
    at_frame(player, 19)
    assert player.box == pytest.approx(player.boxes[19], abs=2e-3)


def test_a_target_is_drawn_on_the_frame_that_is_looked_at(player, moving_square):
    click_at(player, 4)
    at_frame(player, 4)
    player.drag(moving_square.boxes[4])
    player.wait_until(lambda: player.locator("#past").is_hidden(), "newest frame")
    at_frame(player, 4)
    player.wait_until(
        lambda: player.box == pytest.approx(moving_square.boxes[4], abs=1.0), "its box"
    )


def test_the_states_are_drawn_in_their_colors_over_the_whole_recording(player):
    def painted():
        """Shares of the timeline's columns that are painted, and that are green."""
        return player.evaluate(
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

    player.wait_until(lambda: painted()[0] > 0.99, "the whole recording")
    assert painted()[1] > 0.9
    assert player.locator("#ticks span").all_inner_texts() == [
        "0:00",
        "0:00.2",
        "0:00.4",
        "0:00.6",
        "0:00.8",
    ]
    # The target is gone from then on, and its color with it.
    player.keyboard.press("Home")
    at_frame(player, 0)
    player.wait_until(lambda: painted()[0] < 0.1, "the new run")


def test_where_a_detector_starts_the_targets_a_missing_frame_is_stepped_over(player, client):
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
    player.route_web_socket("**/socket", connect)
    player.reload()
    client.set_parameters(built_in_detector="motion")
    choice = player.locator("[id='parameter-built_in_detector']")
    player.wait_until(lambda: choice.count() and choice.input_value() == "motion", "detector")
    player.locator("#seek").fill("8")
    player.locator("#seek").blur()
    at_frame(player, 8)
    for index in (9, 11):
        player.keyboard.press("n")
        if index == 11:
            player.keyboard.press("n")
        at_frame(player, index)
    player.keyboard.press("ArrowLeft")
    at_frame(player, 9)
    assert player.text("again") == "Track again from here (forgets detected targets)"
    player.keyboard.press("ArrowRight")
    at_frame(player, 11)
    assert player.locator("#past").is_hidden()


def test_a_camera_is_looked_back_at_while_it_goes_on(camera, page):
    camera.show_on(page)
    assert page.text("states-empty") == "Waits for a target: its states over time"
    page.drag(camera.box_at(page.stamp))
    camera.show_until(lambda: page.box, "box")
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
