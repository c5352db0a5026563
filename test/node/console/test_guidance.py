"""What a new user needs: what to do, what is shown, and recordings to try it with."""

from threading import Event

import numpy as np
import pytest
import yaml
from console_pages import WATCH_SHIFTS, stamp_at
from rclpy.parameter import Parameter

from pf_tracker_ros.node.console.played_recording import PlayedRecording

LAYERS = {"box": "#box", "particles": "#particles", "ellipse": "#covariance", "trail": "#trail"}
TOPS = """() => Object.fromEntries([...document.querySelectorAll('main [id]')]
  .map(one => [one.id, one.getBoundingClientRect().top]))"""


def test_the_picture_tells_what_to_do_until_the_first_target(camera, page):
    camera.show_on(page)
    hint, pointer = page.locator("#hint"), page.locator("#ghost path")
    empty = page.locator(".plot.empty")
    assert hint.inner_text() == "Drag a box around what to follow"
    assert page.locator("#ghost:not([hidden])").count() == 1
    # The dashed box stands still; its pointer moves where motion is allowed.
    animation = "it => getComputedStyle(it).animationName"
    assert page.locator("#ghost rect").evaluate(animation) == "none"
    assert pointer.evaluate(animation) == "point"
    page.emulate_media(reduced_motion="reduce")
    assert pointer.evaluate(animation) == "none"
    # A plot without a line says what it is.
    assert empty.count() == 4
    about = page.locator("#plot-confidence .slot p").inner_text()
    assert "probability" in about
    assert about.endswith("Waits for a target.")
    assert page.text("confidence") == "\u2013"
    # A recording's transport has no use for a camera.
    assert page.locator("#recording").is_hidden()

    page.drag(camera.box_at(page.stamp), release=False)
    assert hint.is_hidden()
    page.mouse.up()
    camera.show_until(lambda: page.box, "box")
    camera.show_until(lambda: empty.count() == 0, "lines")
    assert hint.is_hidden()
    about = page.locator("#plot-weights .slot p")
    assert about.is_hidden()
    page.get_by_role("button", name="What is this: weight of each cue?").click()
    assert about.is_visible()
    assert "Waits" not in about.inner_text()

    # A click on the only target keeps it.
    x, y, width, height = page.box
    page.mouse.click(*page.to_screen(x + width / 2, y + height / 2))
    page.wait_until(lambda: "is selected" in page.text("note"), "note")
    camera.show_on(page)
    assert page.box[2:] == pytest.approx([width, height], rel=0.2)
    page.keyboard.press("s")
    camera.show_until(lambda: page.text("state") == "idle", "idle")
    assert hint.is_hidden()


def test_the_legend_says_what_is_drawn_and_hides_it(camera, page):
    camera.start_target(page)
    camera.show_on(page)
    for name, shape in LAYERS.items():
        button = page.locator(f"[data-layer={name}]")
        about = button.get_attribute("data-about")
        button.focus()
        assert page.text("about") == about
        assert button.get_attribute("aria-description") == about
        for toggle, pressed in ((lambda: button.press("Enter"), "false"), (button.click, "true")):  # noqa: B023
            toggle()
            assert button.get_attribute("aria-pressed") == pressed
            assert page.locator(shape).is_visible() == (pressed == "true")
    page.locator("#heatmap-button").hover()
    assert "look-alike" in page.text("about")
    # There are no detections.
    assert page.locator("[data-layer=detections]").is_hidden()


@pytest.fixture
def bags(tmp_path, write_images, moving_square):
    """The moving square as two bags of images of other sizes; their first frames have one stamp."""
    images = moving_square.images
    return [
        write_images(chosen, stamp_at).rename(tmp_path / name)
        for name, chosen in (
            ("wide", images),
            ("tall", [np.ascontiguousarray(image[:, :90]) for image in images[:12]]),
        )
    ]


@pytest.fixture
def tour(tmp_path, moving_square):
    """A tour of both bags, and the box that it suggests in the second one."""
    box = [float(value) for value in moving_square.boxes[0]]
    entries = [
        {"recording": "wide", "title": "Square", "parameters": {"particles": 100}},
        {
            "recording": "tall",
            "target": box,
            "speed": 0.5,
            "parameters": {"particles": 150},
            "steps": ["Look.", {"text": "Change it.", "parameters": {"particles": 60}}],
        },
    ]
    path = tmp_path / "tour.yaml"
    path.write_text(yaml.safe_dump(entries))
    return str(path), box


@pytest.mark.usefixtures("tracker")
def test_another_recording_is_opened_from_the_page(client, start_console, open_page, bags, tour):
    path, box = tour
    missing = str(bags[0].parent / "missing.mcap")
    page = open_page(start_console(tour=path, recordings=[missing, str(bags[0])]).url)
    choices = page.locator("#choices button")
    page.at_frame(0)
    assert choices.all_inner_texts() == ["Square", "tall", "missing.mcap"]
    assert (page.size, page.locator("#steps").is_hidden()) == ((160, 120), True)
    page.draw(box)

    choices.nth(1).click()
    page.wait_until(lambda: page.size == (90, 120) and page.shows(stamp_at(0)), "other recording")
    assert (page.text("frame"), page.locator("#speed").input_value()) == ("0 / 11", "0.5")
    page.wait_until(lambda: page.text("state") == "idle", "its state")
    assert page.locator("#target-list li").count() == 0
    # The suggested box is drawn as a ghost.
    names = ("x", "y", "width", "height")
    ghost = page.locator("#ghost:not([hidden]) rect")
    assert [float(ghost.get_attribute(name)) for name in names] == box
    client.wait_for(lambda: client.get_parameters("particles") == [150], "its value")
    # It is of the first frame.
    page.keyboard.press("n")
    page.at_frame(1)
    assert ghost.count() == 0
    page.keyboard.press("Home")
    page.at_frame(0)
    page.wait_until(ghost.count, "suggestion")
    page.draw(box)
    page.keyboard.press("s")
    page.wait_until(ghost.count, "suggestion again")
    page.draw(box)
    assert page.locator("#step-back").is_disabled()
    page.locator("#step-next").click()
    assert page.text("step-count") == "2 of 2"
    page.get_by_role("button", name="Set particles to 60").click()
    client.wait_for(lambda: client.get_parameters("particles") == [60], "the step's value")

    # Opened again, it begins anew.
    choices.nth(1).click()
    page.wait_until(lambda: page.text("step-count") == "1 of 2", "first step")
    page.wait_until(ghost.count, "suggestion anew")
    assert page.locator("#target-list li").count() == 0
    page.locator("#step-next").click()

    # One that cannot be played leaves the present one.
    page.get_by_role("button", name="Next: missing.mcap").click()
    page.wait_for_text("note", "cannot be played: there is no")
    page.at_frame(0)
    assert choices.nth(1).get_attribute("aria-pressed") == "true"
    # A recording of a tour is looped.
    assert page.locator("#loop").get_attribute("aria-pressed") == "true"
    page.locator("#speed").select_option("4")
    page.locator("#play").click()
    page.wait_until(lambda: page.text("frame") == "11 / 11", "end")
    page.wait_until(lambda: page.stamp == stamp_at(0), "beginning")


@pytest.mark.usefixtures("tracker")
def test_nothing_is_drawn_on_a_recording_that_is_being_opened(
    client, start_console, open_page, bags, monkeypatch
):
    page = open_page(start_console(recordings=[str(bag) for bag in bags]).url)
    page.at_frame(0)
    # Missing images are expected meanwhile.
    client.set_parameters(image_timeout=0.5)
    may_open, open_recording = Event(), PlayedRecording.open
    monkeypatch.setattr(
        PlayedRecording, "open", lambda *given: may_open.wait() and open_recording(*given)
    )
    page.locator("#choices button").nth(1).click()
    page.wait_until(lambda: page.text("state") == "opening", "state")
    page.drag((20, 30, 24, 24))
    page.keyboard.press("r")
    assert page.text("note") == "there is no picture to draw on"
    page.wait_for_timeout(1600)
    assert page.text("health") == "the recording is being opened"
    assert page.text("state") == "opening"
    may_open.set()
    page.wait_until(lambda: page.size == (90, 120) and page.text("state") == "idle", "it")
    page.drag((20, 30, 24, 24))
    page.wait_until(lambda: page.box, "box")


@pytest.mark.usefixtures("tracker")
def test_on_a_phone_the_transport_and_the_state_follow_the_picture(
    start_console, open_page, bags, moving_square
):
    console = start_console(source=str(bags[0]))
    page = open_page(console.url, has_touch=True, viewport={"width": 390, "height": 844})
    page.at_frame(0)
    page.wait_until(lambda: page.text("topic"), "name of the topic")
    page.locator("#groups details").first.wait_for(state="attached")
    tops = page.evaluate(TOPS)
    order = ["stage", "recording", "state-card", "legend", "actions", "plots", "figures", "tune"]
    assert sorted(order, key=tops.get) == order
    # In one row, also with hundreds of frames.
    page.locator("#frame").evaluate("it => { it.textContent = '239 / 240'; }")
    tops = page.evaluate(TOPS)
    rows = {tops[name] for name in ("first", "back", "play", "forward", "loop")}
    assert len(rows) == 1
    assert len({tops[name] for name in ("draw", "stop", "more-button")}) == 1
    # The state is seen without scrolling.
    assert tops["health"] < 844
    page.evaluate(WATCH_SHIFTS)
    page.drag(moving_square.boxes[0])
    page.wait_until(lambda: page.box, "box")
    for index in range(1, 6):
        page.keyboard.press("ArrowRight")
        page.at_frame(index)
    page.keyboard.press("ArrowLeft")
    page.wait_until(lambda: page.text("frame") == "4 / 19", "frame before")
    assert page.locator("#time").inner_text() == "" or page.locator("#time").is_hidden()
    page.keyboard.press("Home")
    page.wait_until(lambda: page.text("frame") == "0 / 19", "first frame")
    assert page.evaluate("() => window.shifted") == []
    # Without a keyboard, its keys are not named. The picture to draw on comes into sight.
    assert page.locator("kbd:visible, #keys-button:visible").count() == 0
    page.locator("#draw").evaluate("it => it.scrollIntoView()")
    assert page.locator("#stage").bounding_box()["y"] < 0
    page.locator("#draw").click()
    assert page.locator("#stage").bounding_box()["y"] >= -1
    assert page.text("note") == "drag a box, or move this one by its corners"


def test_a_detector_needs_no_hand(camera, page, tracker):
    camera.show_on(page)
    page.wait_until(lambda: page.text("health").endswith(": drag a box around it"), "advice")
    tracker.set_parameters([Parameter("built_in_detector", value="people")])
    page.wait_until(lambda: "the detector finds it" in page.text("health"), "other advice")
    camera.show_on(page)
    page.wait_until(lambda: page.locator("#hint").is_hidden(), "picture without a hint")


@pytest.mark.usefixtures("tracker")
def test_parameters_are_found_and_tell_what_they_are_on_demand(page):
    page.wait_until(lambda: page.locator("#groups details").count(), "parameters")
    page.locator("#find").fill("MOTION.size_noise")
    shown = page.locator(".parameter:visible")
    assert shown.locator("label:first-child").all_inner_texts() == ["motion.size_noise"]
    about = shown.locator("p.quiet")
    assert about.is_hidden()
    page.get_by_role("button", name="What is motion.size_noise?").click()
    assert about.is_visible()
    page.locator("#find").fill("color xyz")
    assert page.text("unfound") == 'no parameter has "color xyz" in its name or description'
    page.locator("#find").fill("")
    assert page.locator("#unfound").is_hidden()
    assert page.locator(".parameter:visible").count() == 0
