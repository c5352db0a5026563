"""Drawing a target on the live page: by pointer, touch and keyboard."""

import itertools

import pytest
from common import box_of, overlap
from std_srvs.srv import SetBool

from pf_tracker_ros.stamps import stamp_of

HEIGHT, WIDTH = 120, 160


def test_a_dragged_box_starts_the_target_on_the_frame_it_was_drawn_on(shown, camera, client, sent):
    drawn_on = shown.stamp
    wanted = camera.box_at(drawn_on)
    shown.drag(wanted, release=False)
    # The picture is frozen while the camera continues.
    for _ in range(3):
        camera.show()
    assert shown.stamp == drawn_on
    assert shown.locator("#frozen").is_visible()
    shown.mouse.up()
    (target,) = client.wait_for(lambda: sent, "target")
    assert stamp_of(target.header) == drawn_on
    assert overlap(box_of(target), wanted) > 0.9

    camera.show_until(lambda: "accepted" in shown.text("note"), "acceptance")
    camera.show_on(shown)
    assert shown.locator("#frozen").is_hidden()
    assert shown.text("state") == "tracking"


def test_stop_removes_the_target(shown, camera):
    shown.drag(camera.box_at(shown.stamp))
    camera.show_until(lambda: shown.box, "box")
    shown.keyboard.press("s")
    shown.wait_for_text("note", "stopped 1 target; waiting for a target")
    camera.show_on(shown)
    assert shown.text("state") == "idle"
    assert shown.box is None
    assert shown.locator("#box").is_hidden()
    assert shown.locator("#trail").get_attribute("points") == ""


def test_a_box_without_area_is_refused_with_the_nodes_reason(shown):
    shown.drag((20, 50, 60, 0))
    # Without another image, the diagnostics have it.
    shown.wait_for_text("note", "target refused")
    assert "span" in shown.text("note")
    assert "allowed: points that differ in both x and y" in shown.text("note")
    # The box stays, for correction.
    assert shown.locator("#drawn:not([hidden])").count() == 1
    assert shown.locator("#handles circle:visible").count() == 4
    shown.keyboard.press("Escape")
    assert shown.text("note") == "the box is discarded"


@pytest.mark.parametrize(
    ("jumps", "reason"),
    [(False, "older than the oldest one in the buffer"), (True, "before time went back")],
)
def test_a_target_on_a_frame_of_long_ago_is_refused_with_advice(
    shown, camera, client, jumps, reason
):
    if jumps:
        for _ in range(40):
            camera.show()
        camera.show_on(shown)
    client.set_parameters(frame_buffer_length=2, frame_buffer_megabytes=1.0)
    shown.drag(camera.box_at(shown.stamp), release=False)
    if jumps:
        camera.index = 0
    for _ in range(1 if jumps else 80):
        camera.show()
    shown.mouse.up()
    camera.show_until(lambda: "refused" in shown.text("note"), "refusal")
    assert reason in shown.text("note")
    assert shown.text("note").endswith("discard it, pause, then draw")


def test_a_click_tracks_a_square_around_it(shown, camera, client, sent):
    client.set_parameters(click_size=20.0)
    drawn_on = shown.stamp
    shown.mouse.click(*shown.to_screen(60, 50))
    (click,) = client.wait_for(lambda: sent, "click")
    assert (click.point.x, click.point.y) == pytest.approx((60, 50), abs=0.5)
    assert stamp_of(click.header) == drawn_on
    box = camera.show_until(lambda: shown.box, "box")
    assert box[2:] == pytest.approx([20, 20], rel=0.2)


def test_a_corner_is_dragged_to_adjust_the_box(shown, client, sent):
    shown.drag((30, 30, 40, 0))
    first = client.wait_for(lambda: sent, "target")[0]
    shown.locator("#handles").wait_for()
    x, y, width, _ = box_of(first)
    shown.drag((x + width, y, 10, 35))
    client.wait_for(lambda: len(sent) == 2, "second target")
    assert box_of(sent[1]) == pytest.approx((x, y, width + 10, 35), abs=1.0)
    assert stamp_of(sent[1].header) == stamp_of(first.header)


def test_the_box_is_dragged_as_a_whole(shown, client, sent):
    shown.drag((30, 30, 40, 0))
    client.wait_for(lambda: sent, "target")
    shown.locator("#handles").wait_for()
    shown.show_more()
    shown.locator("#box-height").fill("30")
    shown.drag((50, 45, 20, 10))
    client.wait_for(lambda: len(sent) == 2, "second target")
    assert box_of(sent[1]) == pytest.approx((50, 40, 40, 30), abs=1.0)


def test_escape_discards_the_box_and_resumes_the_picture(shown, camera, client, sent):
    shown.drag((20, 20, 50, 50), release=False)
    camera.show()
    shown.keyboard.press("Escape")
    shown.mouse.up()
    assert shown.locator("#drawn").is_hidden()
    camera.show_on(shown)
    # An earlier target would arrive before this one.
    shown.drag((20, 20, 30, 30))
    (target,) = client.wait_for(lambda: sent, "target")
    assert box_of(target) == pytest.approx((20, 20, 30, 30), abs=1.0)


def test_a_box_is_drawn_by_keyboard(shown, camera, client, sent):
    drawn_on = shown.stamp
    shown.keyboard.press("r")
    before = [float(shown.locator(f"#box-{name}").input_value()) for name in ("x", "y")]
    camera.show()
    for key in ("ArrowRight", "ArrowDown", "ArrowDown", "Shift+ArrowLeft", "Alt+ArrowUp"):
        shown.keyboard.press(key)
    shown.keyboard.press("Enter")
    (target,) = client.wait_for(lambda: sent, "target")
    assert stamp_of(target.header) == drawn_on
    x, y = before
    # A step is an 80th of the width, with Alt a pixel.
    assert box_of(target) == pytest.approx((x + 2, y + 3, WIDTH / 4 - 2, HEIGHT / 4))
    camera.show_until(lambda: "accepted" in shown.text("note"), "acceptance")


@pytest.mark.usefixtures("fast_reports")
def test_space_pauses_and_resumes(shown, camera, client):
    shown.keyboard.press("Space")
    shown.locator("#pause[aria-pressed=true]").wait_for()
    assert shown.text("pause-word") == "Resume"
    assert camera.show().values["frame"] == "paused"
    shown.wait_for_text("health", "paused")
    shown.keyboard.press("Space")
    shown.locator("#pause[aria-pressed=false]").wait_for()
    assert camera.show().values["frame"] == "waiting"


def test_keys_in_a_field_are_no_shortcuts(shown, camera):
    shown.keyboard.press("r")
    shown.show_more()
    shown.locator("#box-x").press("s")
    shown.locator("#box-x").press("Space")
    assert shown.locator("#drawn").is_visible()
    assert camera.show().values["frame"] == "waiting"


@pytest.mark.usefixtures("short_discovery")
def test_a_target_without_a_subscriber_is_reported_and_the_picture_resumes(page, client, images):
    """Without a tracker the console shows the images of its topic."""
    stamps = (client.at(index) for index in itertools.count())

    def has_shown(stamp):
        client.images.publish(client.message(images[0], stamp))
        page.wait_for_timeout(20)
        return page.stamp

    client.wait_for(lambda: has_shown(next(stamps)), "picture")
    page.drag((20, 20, 30, 30))
    page.wait_for_text("note", "no subscriber on /pf_tracker/target")
    page.keyboard.press("Escape")
    before = page.stamp
    client.wait_for(lambda: has_shown(next(stamps)) > before, "next picture")


@pytest.mark.usefixtures("short_discovery")
def test_a_missing_service_is_reported(console, client, open_page):
    page = open_page(console.url)
    page.locator("#stop").click()
    page.get_by_text("there is no service /pf_tracker/stop").wait_for()
    assert client.create_client(SetBool, "pf_tracker/enable").service_is_ready() is False
