"""`track --draw`: targets drawn on a page, by HTTP and in a real headless Chromium."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest
import yaml
from common import QUICK, TRACK_WITHOUT_ROS, read_boxes

import pf_tracker_ros
from pf_tracker_ros.pages.access import HEADERS

pytest.importorskip("aiohttp", reason="the page needs the extra 'console'")
from pf_tracker_ros.recordings import RecordingError, open_recording
from pf_tracker_ros.recordings.drawing import progress, server
from pf_tracker_ros.recordings.drawing.progress import Progress, WrittenFiles
from pf_tracker_ros.recordings.drawing.server import TargetPage
from pf_tracker_ros.recordings.target import Target

BOX = [20.0, 30.0, 24.0, 24.0]
FIRST = {"frame": 0, "box": BOX}
DEADLINE = 60


class DrawCommand:
    """A `track --draw` that waits for a target; without ROS.

    Attributes:
        process: The command.
        address: Of its page.
    """

    def __init__(self, *arguments):
        self.process = subprocess.Popen(
            [sys.executable, "-c", TRACK_WITHOUT_ROS, *map(str, arguments), "--draw", *QUICK],
            env={**os.environ, "PYTHONPATH": str(Path(pf_tracker_ros.__file__).parents[1])},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line + self.process.stderr.read()
        self.address = found[0]

    def ask(self, path, method="GET", body=None, **headers):
        """Status, headers and body of the response to a request."""
        parts = urlsplit(self.address)
        connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=DEADLINE)
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            return response.status, dict(response.getheaders()), response.read()
        finally:
            connection.close()

    def send(self, path, body="", origin=None):
        """Status and text of the response to a POST request."""
        origin = origin or self.address.strip("/")
        status, _, text = self.ask(path, "POST", body, Origin=origin)
        return status, text.decode()

    def draw(self, box, frame=0):
        return self.draw_all({"frame": frame, "box": box})

    def draw_all(self, *targets):
        return self.send("/targets", json.dumps({"targets": targets}))

    def end(self):
        """Wait for the end, and return exit code, output and errors."""
        output, errors = self.process.communicate(timeout=DEADLINE)
        return self.process.returncode, output, errors


@pytest.fixture
def start_draw():
    """A function that starts the command; it is killed after the test."""
    commands = []

    def start(*arguments):
        commands.append(DrawCommand(*arguments))
        return commands[-1]

    yield start
    for command in commands:
        command.process.kill()
        command.process.communicate()


@pytest.fixture
def images(moving_square_sequence):
    """A recording without a target."""
    return moving_square_sequence / "img"


@pytest.fixture
def open_page(browser):
    """A function that opens the page of a command; complaints fail the test."""
    contexts, complaints = [], []

    def open_one(command):
        context = browser.new_context()
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(command.address)
        page.locator("#overlay[data-frame='0']").wait_for(state="attached")
        return page

    yield open_one
    for context in contexts:
        context.close()
    assert complaints == []


def on_screen(page, x, y):
    """Position on the page of a pixel of the picture of 160 x 120 px."""
    area = page.locator("#overlay").bounding_box()
    return area["x"] + x * area["width"] / 160, area["y"] + y * area["height"] / 120


def drag(page, start, end):
    page.mouse.move(*on_screen(page, *start))
    page.mouse.down()
    page.mouse.move(*on_screen(page, (start[0] + end[0]) / 2, (start[1] + end[1]) / 2))
    page.mouse.move(*on_screen(page, *end))
    page.mouse.up()


def first_box(folder):
    row = next(row for row in read_boxes(folder) if row["x"])
    return int(row["frame"]), [float(row[name]) for name in ("x", "y", "width", "height")]


@pytest.mark.parametrize("max_targets", [2, 1])
def test_the_note_offers_another_target_if_there_may_be_one(
    start_draw, open_page, images, max_targets
):
    output = images.parents[1] / "out"
    command = start_draw(images, "--output", output, "--parameter", f"max_targets={max_targets}")
    page = open_page(command)
    note = page.locator("#note")
    offered = "; A keeps it and adds another target" if max_targets > 1 else "Escape drops it"
    assert note.inner_text().endswith(offered)
    page.keyboard.press("Enter")
    page.get_by_text("there is no box yet: drag one around the target, or press R").wait_for()
    assert note.get_attribute("data-level") == "error"
    page.keyboard.press("r")
    page.get_by_text("drag a box around the target").wait_for()
    assert (note.inner_text().endswith(offered), note.get_attribute("data-level")) == (True, "ok")
    if max_targets == 1:
        return
    drag(page, (20, 30), (44, 54))
    page.keyboard.press("a")
    # No more than `max_targets` are kept.
    drag(page, (100, 20), (140, 60))
    assert page.locator("#add").is_disabled()
    page.keyboard.press("a")
    assert page.locator("#list li").count() == 1
    page.keyboard.press("Escape")
    # The kept targets are tracked without another box.
    page.keyboard.press("Enter")
    page.get_by_text("tracking; the outcome comes here").wait_for()
    assert command.end()[0] == 0
    assert {row["id"] for row in read_boxes(output)} == {"1"}


def test_a_box_is_drawn_on_another_frame_by_keys(start_draw, open_page, images, tmp_path):
    command = start_draw(images, "--output", tmp_path / "out")
    page = open_page(command)
    for number in range(1, 4):
        page.keyboard.press("n")
        page.locator(f"#overlay[data-frame='{number}']").wait_for(state="attached")
    drag(page, (5, 5), (50, 50))
    page.keyboard.press("Escape")
    assert page.locator("#drawn:not([hidden])").count() == 0
    page.locator("#draw").click()
    for name, value in zip(("x", "y", "width", "height"), (32, 36, 24, 24), strict=True):
        page.locator(f"#box-{name}").fill(str(value))
    page.locator("#send").click()
    page.get_by_text("tracking; the outcome comes here").wait_for()
    assert command.end()[0] == 0
    assert first_box(tmp_path / "out") == (3, [32.0, 36.0, 24.0, 24.0])
    assert [row["state"] for row in read_boxes(tmp_path / "out")[:4]] == ["idle"] * 3 + ["tracking"]


def test_several_targets_are_drawn_undone_and_tracked(start_draw, open_page, track, images):
    tmp_path = images.parents[1]
    command = start_draw(images, "--output", tmp_path / "out")
    page = open_page(command)
    assert page.locator("#send").is_disabled()
    assert page.locator("#add").is_disabled()
    assert page.locator("#undo").is_disabled()
    assert page.locator("#name").inner_text() == "img"
    drag(page, (20, 30), (60, 70))
    assert page.locator("#handles circle:visible").count() == 4
    drag(page, (60, 70), (44, 54))
    page.locator("#label").fill("\u00e4: 'square'")
    page.locator("#add").click()
    assert page.locator("#drawn:not([hidden])").count() == 0
    assert page.locator("#kept rect").count() == 1
    drag(page, (100, 20), (140, 60))
    page.keyboard.press("a")
    page.keyboard.press("u")
    assert page.locator("#list li").count() == 1
    # Undo removes the box that is being edited first.
    drag(page, (100, 20), (140, 60))
    page.keyboard.press("u")
    assert page.locator("#drawn:not([hidden])").count() == 0
    assert page.locator("#list li").count() == 1
    for number in range(1, 3):
        page.keyboard.press("n")
        page.locator(f"#overlay[data-frame='{number}']").wait_for(state="attached")
    # Targets of another frame are only in the list.
    assert page.locator("#kept rect").count() == 0
    assert page.locator("#list li").inner_text().startswith("\u00e4: 'square', frame 0: 20")
    page.keyboard.press("r")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.get_by_text("tracking; the outcome comes here").wait_for()
    code, output, errors = command.end()
    assert (code, errors) == (0, "")
    file = images.parent / "img.target.yaml"
    assert output.splitlines()[0].startswith("targets ")
    assert f"saved as {file}" in output
    saved = yaml.safe_load(file.read_text())
    assert saved["recording"] == "img"
    first, second = saved["targets"]
    assert first["image_size"] == second["image_size"] == [160, 120]
    assert first["label"] == "\u00e4: 'square'"
    assert (first["frame"], first["target_box"]) == (0, pytest.approx(BOX, abs=0.5))
    assert (second["frame"], second["target_box"]) == (2, [62.0, 45.0, 40.0, 30.0])
    found = read_boxes(tmp_path / "out")
    assert {row["id"] for row in found} == {"1", "2"}
    assert next(row["frame"] for row in found if row["id"] == "2") == "2"
    # The saved targets give the same boxes.
    assert track(images, "--output", tmp_path / "again", *QUICK)[0] == 0
    assert (tmp_path / "again/boxes.csv").read_bytes() == (tmp_path / "out/boxes.csv").read_bytes()


def test_cancel_on_the_page_ends_without_tracking(start_draw, open_page, images, tmp_path):
    command = start_draw(images, "--output", tmp_path / "out")
    page = open_page(command)
    page.locator("#cancel").click()
    page.get_by_text("nothing is tracked; this page can be closed").wait_for()
    code, _, errors = command.end()
    assert code == 2
    assert errors.startswith("track: error: no target was drawn")
    assert not (tmp_path / "out").exists()
    assert not (images.parent / "img.target.yaml").exists()


@pytest.mark.parametrize("moment", ["before the page", "while drawing"])
def test_a_signal_before_a_target_is_drawn_ends_it(start_draw, images, track, monkeypatch, moment):
    def signaled(*_):
        os.kill(os.getpid(), signal.SIGTERM)

    output = images.parents[1] / "out"
    if moment == "while drawing":
        command = start_draw(images, "--output", output)
        assert command.ask("/")[0] == 200
        command.process.send_signal(signal.SIGTERM)
        code, _, errors = command.end()
    else:
        monkeypatch.setattr("pf_tracker_ros.recordings.run.check_applies", signaled)
        code, _, errors = track(images, "--output", output, "--draw", *QUICK)
    assert code == 143
    assert errors.count("\n") == 1
    assert "terminated before a target was drawn; nothing was tracked" in errors
    assert not output.exists()


def finished_page(command, open_page):
    """The page of a command whose target is drawn, when it shows the report."""
    pytest.importorskip("matplotlib")
    page = open_page(command)
    drag(page, (20, 30), (44, 54))
    page.keyboard.press("Enter")
    page.locator("#report:not([hidden])").wait_for()
    page.frame_locator("#report").get_by_text("frame 0, 0.00 s: tracking").wait_for()
    return page


def test_the_page_goes_from_the_box_to_the_report(start_draw, open_page, images, tmp_path):
    output = tmp_path / "out"
    command = start_draw(images, "--output", output, "--video", "--report", tmp_path / "report")
    page = finished_page(command, open_page)
    page.get_by_text("20 frames (").wait_for()
    # The report finds the video, though it lies in another folder.
    video = page.frame_locator("#report").locator("#video")
    assert video.get_attribute("src") == "../out/overlay.mp4"
    names = page.locator("#files a").all_inner_texts()
    assert names == ["boxes.csv", "overlay.mp4", "report.html"]
    addresses = [one.get_attribute("href") for one in page.locator("#files a").all()]
    assert addresses[0] == "/results/out/boxes.csv"
    for address in addresses:
        assert command.ask(address)[0] == 200
    assert command.ask(addresses[1], Range="bytes=0-3")[0] == 206
    assert command.ask("/results/out/boxes.csv")[2] == (output / "boxes.csv").read_bytes()
    for other in ("/results/", "/results/out", "/results/../img.target.yaml", "/results/%2e%2e"):
        assert command.ask(other)[0] == 404
    assert command.ask(addresses[2], Host="attacker.example")[0] == 403
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    header = page.locator("header")
    assert header.evaluate("it => it.scrollHeight <= it.clientHeight")
    assert command.process.poll() is None
    page.close()
    code, printed, errors = command.end()
    assert (code, errors) == (0, "")
    assert printed.endswith("the page shows the report; close it, or press Ctrl-C, to end\n")


def test_a_signal_ends_the_page_with_the_report(start_draw, open_page, images, tmp_path):
    command = start_draw(images, "--output", tmp_path / "out", "--report")
    page = finished_page(command, open_page)
    command.process.send_signal(signal.SIGINT)
    assert command.end()[::2] == (0, "")
    page.close()


def test_a_page_that_is_closed_during_tracking_does_not_hold_its_end(
    open_page, images, monkeypatch, tmp_path
):
    is_noticed = threading.Event()

    class WatchedProgress(Progress):
        async def on_request(self, request):
            try:
                return await super().on_request(request)
            finally:
                is_noticed.set()

    monkeypatch.setattr(server, "Progress", WatchedProgress)
    monkeypatch.setattr(progress, "_GONE_AFTER", 0.0)
    addresses = Queue()
    target_page = TargetPage(addresses.put)
    with ThreadPoolExecutor(1) as tracking:
        try:
            asked = tracking.submit(target_page.ask, open_recording(images), 1)
            page = open_page(SimpleNamespace(address=addresses.get(timeout=DEADLINE)))
            drag(page, (20, 30), (44, 54))
            with page.expect_response("**/progress"):
                page.keyboard.press("Enter")
            assert len(asked.result(DEADLINE)) == 1
            page.close()
            assert is_noticed.wait(DEADLINE)
            report = tmp_path / "report.html"
            finished = tracking.submit(target_page.finish, "", WrittenFiles([report], report))
            finished.result(DEADLINE)
        finally:
            target_page.close()


def test_a_target_is_drawn_by_http_and_its_tracking_told(start_draw, images, tmp_path):
    file = images.parent / "img.target.yaml"
    file.write_text("target_box: [1, 2, 30, 40]")
    command = start_draw(images, "--output", tmp_path / "out")
    assert command.ask("/picture")[0] == 404
    assert command.ask("/results/boxes.csv")[0] == 404
    connection = http.client.HTTPConnection(
        "127.0.0.1", urlsplit(command.address).port, timeout=DEADLINE
    )
    connection.request("GET", "/progress")
    events = connection.getresponse()
    assert json.loads(events.readline().removeprefix(b"data: ")) == {"frame": None}
    # The request comes in several pieces.
    status, text = command.send("/targets", " " * 2**18 + json.dumps({"targets": [FIRST]}))
    assert (status, text) == (200, "tracking; the outcome comes here")
    code, printed, _ = command.end()
    lines = [line for line in events.read().splitlines() if line.startswith(b"data: ")]
    last = json.loads(lines[-1].removeprefix(b"data: "))
    connection.close()
    assert code == 0
    assert "the page shows the report" not in printed
    assert last["text"].startswith("20 frames (")
    assert last["report"] is None
    assert last["files"] == [["boxes.csv", "/results/boxes.csv"]]
    assert first_box(tmp_path / "out") == (0, BOX)
    # A target file is never overwritten.
    assert f"not saved, because {file} exists already" in printed
    assert file.read_text() == "target_box: [1, 2, 30, 40]"


@pytest.mark.parametrize(("error", "raised"), [(OSError, RecordingError), (ValueError, ValueError)])
def test_a_page_that_cannot_be_served_is_an_error(images, monkeypatch, error, raised):
    async def fail(*address):
        raise error("no loopback")

    monkeypatch.setattr("pf_tracker_ros.recordings.drawing.server.Site.serve", fail)
    with pytest.raises(raised, match="no loopback"):
        TargetPage(print).ask(open_recording(images), 1)


def test_only_valid_targets_of_the_same_origin_are_tracked(start_draw, images, tmp_path):
    command = start_draw(images, "--output", tmp_path / "out")
    for path in ("/", "/draw.js", "/box_editor.js", "/page.css", "/recording", "/frame?number=0"):
        status, headers, _ = command.ask(path)
        assert status == 200
        assert headers.items() >= HEADERS.items()
    body = json.dumps({"targets": [FIRST]})
    for origin in ("http://attacker.example", "null", "http://127.0.0.1:1"):
        for path in ("/targets", "/cancel"):
            assert command.send(path, body, origin)[0] == 403
    assert command.ask("/targets", "POST", body)[0] == 403
    assert command.ask("/", Host="attacker.example")[0] == 403
    assert command.ask("/../server.py")[0] == 404
    for box, message in (
        ([900, 30, 24, 24], "is outside the image, 160 x 120 px"),
        ([1, 2, 3, 0], "too small"),
        ([1, 2, 3], "expected four finite numbers"),
        (None, "expected four finite numbers"),
        ("box", "expected four finite numbers"),
    ):
        status, text = command.draw(box)
        assert (status, message in text) == (422, True), text
    assert command.draw(BOX, frame=400) == (422, "there is no image in frame 400 or after it")
    assert command.draw(BOX, frame="1") == (422, "target 1: its 'frame' is no integer")
    for body in ("", "[]", '{"targets": [1]}', '{"targets": []}', "{}", "\x00", "[" * 4000):
        assert command.send("/targets", body)[0] == 422
    for label in (3, "\x00", "\ud800", "x" * 101):
        status, text = command.draw_all({"frame": 0, "box": BOX, "label": label})
        assert (status, "its label is invalid" in text) == (422, True)
    status, text = command.draw_all(*[{"frame": 0, "box": BOX}] * 33)
    assert (status, text) == (422, "there are 33 targets; allowed: 32")
    status, text = command.draw_all({"frame": 0, "box": BOX}, {"frame": 0, "box": [1, 2, 3, 0]})
    assert (status, text.startswith("target 2: ")) == (422, True)
    assert command.ask("/frame?number=-1")[0] == 400
    assert command.ask(f"/frame?number={'9' * 5000}")[0] == 400
    assert command.ask("/frame?number=20")[0] == 404
    status, headers, _ = command.ask("/frame?number=19")
    assert (status, headers["X-Frame"], headers["X-Size"]) == (200, "19", "160 120")
    assert command.draw(BOX)[0] == 200
    assert command.end()[0] == 0


def test_other_errors_are_reported_before_the_page(track, images, tmp_path):
    taken, free = tmp_path / "taken", ("--output", tmp_path / "out", "--draw")
    taken.mkdir()
    (taken / "boxes.csv").write_text("mine")
    none = ("--detections", tmp_path / "none.csv")
    for arguments, expected, said in (
        ((images, "--output", taken, "--draw"), 4, "boxes.csv exists already"),
        ((images, *free, "--box", "1,2,3,4"), 2, ""),
        ((images, *free, *none), 8, "none.csv"),
    ):
        code, printed, errors = track(*arguments)
        assert (code, printed, said in errors) == (expected, "", True), errors


def test_a_bag_without_a_decodable_image_is_an_error(track, make_stamped, write_bag, tmp_path):
    kind = "sensor_msgs/msg/CompressedImage"
    message = make_stamped(kind, 1, format="jpeg", data=np.zeros(9, np.uint8))
    bag = write_bag(tmp_path / "bag", [("/eye", kind, 1, message)])
    code, _, errors = track(bag, "--output", tmp_path / "out", "--draw")
    assert (code, "cannot be drawn on: there is no image in frame 0" in errors) == (2, True)


def test_the_page_gets_max_targets(track, images, monkeypatch, tmp_path):
    limits = []

    def draw(page, recording, max_targets):
        limits.append(max_targets)
        return (Target(tuple(BOX), 10**9, 0, (160, 120), "the page"),)

    monkeypatch.setattr(server.TargetPage, "ask", draw)
    # Only detections need SciPy.
    monkeypatch.setitem(sys.modules, "scipy", None)
    assert track(images, "--output", tmp_path / "many", "--draw", *QUICK)[0] == 0
    few = ("--parameter", "max_targets=3")
    assert track(images, "--output", tmp_path / "few", "--draw", *QUICK, *few)[0] == 0
    assert limits == [32, 3]
    # One drawn target has the columns of a single target, unless `max_targets` is given.
    heads = [(tmp_path / n / "boxes.csv").read_text().splitlines()[0] for n in ("many", "few")]
    assert [head.endswith(",label") for head in heads] == [False, True]
