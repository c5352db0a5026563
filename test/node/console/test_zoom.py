"""Zoom and pan of the picture, and boxes drawn on the zoomed picture."""

import pytest
from common import box_of
from console_pages import WATCH_MESSAGES

CENTER = (80.0, 60.0)


def zoom_of(page):
    """The width of the picture relative to that of the stage."""
    widths = (page.locator(f"#{name}").bounding_box()["width"] for name in ("view", "stage"))
    return next(widths) / next(widths)


def pixel_at(page, x, y):
    """The pixel of the picture at a position of the page."""
    area, (width, height) = page.locator("#overlay").bounding_box(), page.size
    return (x - area["x"]) * width / area["width"], (y - area["y"]) * height / area["height"]


def wheel_at(page, place, steps):
    """Turn the wheel over a pixel of the picture, up for positive steps."""
    x, y = page.to_screen(*place)
    page.mouse.move(x, y)
    for _ in range(abs(steps)):
        before = zoom_of(page)
        page.mouse.wheel(0, -200 if steps > 0 else 200)
        page.wait_until(lambda: zoom_of(page) != before, "other zoom")  # noqa: B023
    return x, y


def move_view(page, start, end, button="middle"):
    """Drag the view from one position of the page to another."""
    page.mouse.move(*start)
    page.mouse.down(button=button)
    page.mouse.move(*end, steps=3)
    page.mouse.up(button=button)


def test_the_wheel_zooms_around_the_pointer(shown):
    x, y = wheel_at(shown, (40, 90), 3)
    assert zoom_of(shown) == pytest.approx(2.718281828**1.2, rel=0.01)
    assert pixel_at(shown, x, y) == pytest.approx((40, 90), abs=0.2)
    # The page itself does not scroll.
    assert shown.evaluate("() => scrollY") == 0
    assert shown.text("zoom-fit") == "3.3 x"
    # Moved beyond a corner, it still fills the stage.
    move_view(shown, (x, y), (x + 3000, y + 3000))
    view, stage = (shown.locator(f"#{name}").bounding_box() for name in ("view", "stage"))
    assert (view["x"], view["y"]) == pytest.approx((stage["x"], stage["y"]), abs=0.5)
    shown.keyboard.press("0")
    assert shown.locator("#view").bounding_box() == pytest.approx(stage, abs=0.5)


def test_a_box_drawn_on_the_zoomed_and_panned_picture_is_right(shown, client, sent, camera):
    wheel_at(shown, (50, 40), 4)
    assert zoom_of(shown) > 4
    # Pan, so that the corner of the view is anywhere.
    x, y = shown.to_screen(50, 40)
    move_view(shown, (x, y), (x + 37, y - 21))
    assert pixel_at(shown, x + 37, y - 21) == pytest.approx((50, 40), abs=0.2)
    # Back with the left button and space, which does not pause then.
    shown.keyboard.down("Space")
    move_view(shown, (x + 37, y - 21), (x, y), button="left")
    shown.keyboard.up("Space")
    assert pixel_at(shown, x, y) == pytest.approx((50, 40), abs=0.2)
    assert camera.show().values["frame"] == "waiting"
    assert sent == []
    shown.drag((45, 35, 12, 9))
    (target,) = client.wait_for(lambda: sent, "target")
    assert box_of(target) == pytest.approx((45, 35, 12, 9), abs=0.25)


def test_a_double_click_fits_the_picture_and_starts_nothing(shown, client, sent):
    wheel_at(shown, (60, 50), 3)
    shown.mouse.dblclick(*shown.to_screen(60, 50))
    shown.wait_until(lambda: zoom_of(shown) == pytest.approx(1), "whole picture")
    # An earlier click would arrive before this one.
    shown.mouse.click(*shown.to_screen(30, 20))
    (click,) = client.wait_for(lambda: sent, "click")
    assert (click.point.x, click.point.y) == pytest.approx((30, 20), abs=0.5)


def test_buttons_and_keys_zoom_around_the_middle_and_arrow_keys_move(shown):
    shown.get_by_role("button", name="Zoom in").click()
    shown.keyboard.press("+")
    assert zoom_of(shown) == pytest.approx(2.25)
    middle = shown.locator("#stage").bounding_box()
    x, y = middle["x"] + middle["width"] / 2, middle["y"] + middle["height"] / 2
    assert pixel_at(shown, x, y) == pytest.approx(CENTER, abs=0.2)
    shown.keyboard.press("-")
    assert zoom_of(shown) == pytest.approx(1.5)
    # By key, with a focused button.
    button = shown.locator("#zoom-in")
    button.focus()
    button.press("Enter")
    button.press("ArrowRight")
    button.press("ArrowDown")
    assert pixel_at(shown, x, y) == pytest.approx((80 + 16 / 2.25, 60 + 12 / 2.25), abs=0.2)
    shown.locator("#zoom-fit").press("Enter")
    assert zoom_of(shown) == pytest.approx(1)


def test_two_fingers_zoom_and_pan_and_draw_nothing(camera, console, open_page, sent, client):
    page = open_page(console.url, has_touch=True, viewport={"width": 390, "height": 844})
    camera.show_on(page)
    touch = page.context.new_cdp_session(page.page).send

    def fingers(kind, *places):
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
        touch("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    x, y = page.to_screen(*CENTER)
    fingers("touchStart", (x - 30, y))
    fingers("touchMove", (x - 32, y + 5))
    # The first finger has begun a box.
    fingers("touchStart", (x - 32, y), (x + 32, y))
    fingers("touchMove", (x - 64, y), (x + 64, y))
    page.wait_until(lambda: zoom_of(page) == pytest.approx(2, rel=0.05), "zoom")
    assert pixel_at(page, x, y) == pytest.approx(CENTER, abs=1.0)
    fingers("touchMove", (x - 44, y + 10), (x + 84, y + 10))
    page.wait_until(lambda: pixel_at(page, x + 20, y + 10) == pytest.approx(CENTER, abs=1.5), "pan")
    fingers("touchEnd", (x - 44, y + 10))
    fingers("touchMove", (x - 10, y + 60))
    fingers("touchEnd")
    assert page.locator("#drawn").is_hidden()
    assert sent == []
    # One finger draws again.
    places = [page.to_screen(*place) for place in ((70, 50), (80, 60), (90, 70))]
    for kind, place in zip(("touchStart", "touchMove", "touchMove"), places, strict=True):
        fingers(kind, place)
    fingers("touchEnd")
    (target,) = client.wait_for(lambda: sent, "target")
    assert box_of(target) == pytest.approx((70, 50, 20, 20), abs=1.0)


def test_more_pixels_are_sent_for_a_zoomed_picture(console, camera, open_page, tracker):
    page = open_page(console.url, viewport={"width": 360, "height": 700})
    camera.show_on(page)
    narrow = int(page.evaluate("() => document.querySelector('#overlay').clientWidth"))
    assert narrow > 160
    page.evaluate(WATCH_MESSAGES)
    page.keyboard.press("+")

    def widths():
        return [one["width"] for one in page.evaluate("() => window.sent") if one["type"] == "view"]

    page.wait_until(lambda: (widths() or [0])[-1] > 1.4 * narrow, "width")
