"""Several targets: their messages as JSON, and a page that shows, selects and stops them."""

import itertools
import re
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import ColorRGBA, UInt32
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.node.console.json_conversions import (
    boxes_to_json,
    detections_to_json,
    id_message,
    status_to_json,
)

HOSTILE = "<img src=x onerror=alert(1)>"
LATCHED = QoSProfile(
    depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
RED = ColorRGBA(r=1.0, g=0.5, b=0.0, a=1.0)


def status(name="", message="", **values):
    items = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name=name, message=message, values=items)


def marker(id, corners, namespace="boxes"):
    points = [Point(x=float(x), y=float(y)) for x, y in corners]
    return Marker(ns=namespace, id=id, action=Marker.ADD, points=points, color=RED)


def corners_of(x, y, width, height):
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]


def test_targets_have_id_label_and_state_of_their_status():
    statuses = [
        status(id="1", label="7", state="tracking", confidence="0.75"),
        status(id="20000001", label=HOSTILE, state="lost"),
        status(state="tracking"),
        status(id="1e3", state="tracking"),
    ]
    for selected, expected in (("20000001", "20000001"), ("2", ""), ("0", ""), (HOSTILE, "")):
        own = status("/pf_tracker", "all is well", state="tracking", selected=selected)
        converted = status_to_json(DiagnosticArray(status=[own, *statuses]))
        assert (converted["message"], converted["values"]["state"]) == ("all is well", "tracking")
        assert converted["targets"] == [
            {"id": "1", "label": "7", "state": "tracking", "confidence": 0.75},
            {"id": "20000001", "label": HOSTILE, "state": "lost", "confidence": None},
        ]
        # An ended target cannot be selected.
        assert converted["selected"] == expected


def test_boxes_are_those_of_the_markers_by_id():
    message = MarkerArray(
        markers=[
            Marker(action=Marker.DELETEALL),
            marker(3, corners_of(10, 20, 30, 40)),
            marker(3, [(10, 20)], "labels"),
            marker(4, [(float("nan"), 0), (1, 1)]),
            marker(5, [(-1.7e308, 0), (1.7e308, 1)]),
            marker(5, []),
        ]
    )
    assert boxes_to_json(message) == {"3": {"box": [10.0, 20.0, 30.0, 40.0], "color": "#ff8000"}}


def detection(x, y, width, height, theta=0.0, **scores):
    center = SimpleNamespace(position=SimpleNamespace(x=x, y=y), theta=theta)
    results = [
        SimpleNamespace(hypothesis=SimpleNamespace(class_id=label, score=score))
        for label, score in scores.items()
    ]
    bbox = SimpleNamespace(center=center, size_x=width, size_y=height)
    return SimpleNamespace(bbox=bbox, results=results)


def test_detections_are_upright_boxes_with_the_best_label():
    message = SimpleNamespace(
        detections=[
            detection(50.0, 60.0, 20.0, 10.0, car=0.2, van=0.7),
            detection(50.0, 60.0, 20.0, 10.0, theta=np.pi / 2),
            # Boxes without a finite angle count as upright, as in the tracker.
            detection(50.0, 60.0, 20.0, 10.0, theta=np.inf),
            detection(50.0, 60.0, 20.0, 10.0, theta=np.nan),
            detection(float("nan"), 0.0, 1.0, 1.0),
        ]
    )
    assert detections_to_json(message) == [
        {"box": [40.0, 55.0, 20.0, 10.0], "label": "van"},
        {"box": [45.0, 50.0, 10.0, 20.0], "label": ""},
        {"box": [40.0, 55.0, 20.0, 10.0], "label": ""},
        {"box": [40.0, 55.0, 20.0, 10.0], "label": ""},
    ]


@pytest.mark.parametrize("id", ["", "-1", "1.0", "one", "²", "4294967296", "9" * 5000])
def test_an_invalid_id_is_refused(id):
    with pytest.raises(ValueError, match="there is no target"):
        id_message(id)


class MultiTargetStandIn(Node):
    """A stand-in for a tracker of several targets.

    Attributes:
        targets: Label and state by id; those that are not lost have a box.
        stopped: Ids received on `~/stop_target`.
        selected: Last id received on `~/select`, 0 for none.
        message: Of the status and of the diagnostics.
        is_late: Whether no results come.
        is_slow: Whether the next frame takes long.
    """

    def __init__(self, context):
        super().__init__("pf_tracker", context=context)
        self.declare_parameter("max_targets", 4)
        self.declare_parameter("detector.labels", ["person", "car"])
        self.targets = {1: ("car", "tracking"), 2: (HOSTILE, "occluded"), 3: ("", "lost")}
        self.stopped, self.selected = [], 0
        self.message = "tracking 3 targets"
        self.is_late = self.is_slow = False
        self._status = self.create_publisher(DiagnosticArray, "~/status", LATCHED)
        self._boxes = self.create_publisher(MarkerArray, "~/boxes", 10)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(Image, "image", self._on_image, 10)
        self.create_subscription(UInt32, "~/stop_target", self._on_stop, 10)
        self.create_subscription(UInt32, "~/select", self._on_select, 10)
        self.create_timer(0.2, self._publish_diagnostics)

    @staticmethod
    def box(id):
        return [10.0 * id, 5.0 * id, 30.0, 20.0]

    def _on_image(self, image):
        if self.is_late:
            return
        markers = [Marker(header=image.header, action=Marker.DELETEALL)]
        own = {"state": "tracking", "frame": "tracked", "selected": str(self.selected)}
        own["processing_time_ms"] = "900" if self.is_slow else "5"
        self.is_slow = False
        statuses = [status("/pf_tracker", self.message, **own)]
        for id, (label, state) in self.targets.items():
            name = f"/pf_tracker: target {id}"
            statuses.append(status(name, id=str(id), label=label, state=state, confidence="0.5"))
            if state != "lost":
                markers.append(marker(id, corners_of(*self.box(id))))
        self._boxes.publish(MarkerArray(markers=markers))
        self._status.publish(DiagnosticArray(header=image.header, status=statuses))

    def _on_stop(self, message):
        self.stopped.append(message.data)
        self.targets.pop(message.data, None)

    def _on_select(self, message):
        self.selected = message.data

    def _publish_diagnostics(self):
        health = status("pf_tracker: tracker", self.message, image_topic="/image")
        self._health.publish(DiagnosticArray(status=[health]))


@pytest.fixture
def multi_tracker(graph):
    node = MultiTargetStandIn(graph.context())
    graph.run(node)
    return node


@pytest.fixture
def shown(multi_tracker, client, page, images):
    """A page with the targets, and a function that shows frames until a condition holds."""
    numbers = iter(range(100_000))

    def show_until(condition, what):
        def shows():
            client.images.publish(client.message(images[0], client.at(next(numbers))))
            page.wait_for_timeout(30)
            return condition()

        return page.wait_until(shows, what)

    page.locator("#targets-card").wait_for()
    show_until(lambda: page.locator("#targets rect").count() == 2, "boxes")
    return page, show_until


def rectangle(rect):
    names = ("x", "y", "width", "height")
    return [float(rect.get_attribute(name)) for name in names]


def test_every_target_is_drawn_with_its_id_and_listed_with_its_state(shown, multi_tracker):
    page, show_until = shown
    rects, texts = page.locator("#targets rect"), page.locator("#targets text")
    assert [rectangle(rects.nth(i)) for i in range(2)] == [multi_tracker.box(i) for i in (1, 2)]
    assert texts.all_text_contents() == ["1 car", f"2 {HOSTILE}"]
    assert {rects.nth(i).get_attribute("stroke") for i in range(2)} == {"#ff8000"}
    rows = page.locator("#target-list .choose").all_text_contents()
    assert rows == [
        "1 car · tracking 50 %",
        f"2 {HOSTILE} · occluded 50 %, behind 1 car",
        "3 · lost 50 %, not seen any more",
    ]
    assert page.text("target-count") == "3 of 4"
    # The timeline says the same of the last moment.
    timeline = page.locator("#timeline")
    show_until(
        lambda: timeline.get_attribute("aria-valuetext").endswith(f": {'; '.join(rows)}"), "it"
    )
    # Each target has its line of confidence.
    show_until(lambda: page.locator("#plot-confidence path").count() == 3, "lines")
    assert page.locator("img, script:not([src])").count() == 0
    about = page.locator("#plot-effective .slot p")
    show_until(lambda: about.inner_text().endswith("a selected target; a click selects."), "wait")
    # No target is selected, so there is no likelihood.
    assert page.box is None
    page.keyboard.press("h")
    page.wait_until(lambda: "click a target to select it" in page.text("note"), "hint")


def test_the_reason_stands_for_the_words_of_the_state(shown, multi_tracker):
    page, show_until = shown
    multi_tracker.targets = {3: ("", "lost")}
    multi_tracker.message = "the target is lost"
    show_until(lambda: page.text("health") == "not seen any more", "reason alone")
    multi_tracker.targets = {2: ("", "lost"), 3: ("", "lost")}
    multi_tracker.message = "tracking 2 targets"
    show_until(lambda: page.text("health") == "tracking 2 targets", "words")


def test_no_row_of_five_targets_is_cut(shown, multi_tracker):
    page, show_until = shown
    # Each tells in two lines or more why it is out of sight.
    multi_tracker.targets = dict.fromkeys(range(1, 6), ("person", "occluded"))
    rows = page.locator("#target-list .choose")
    show_until(lambda: rows.count() == 5 and "occluded" in rows.last.inner_text(), "targets")
    hidden = page.locator("#target-list").evaluate("list => list.scrollHeight - list.clientHeight")
    assert hidden <= 0


def test_the_list_stays_while_pictures_come_without_results(shown, multi_tracker):
    page, show_until = shown
    rows = page.locator("#target-list li")
    multi_tracker.is_late = True
    show_until(lambda: page.locator("#targets rect").count() == 0, "picture without results")
    assert rows.count() == 3
    multi_tracker.is_late, multi_tracker.targets = False, {}
    show_until(lambda: rows.count() == 0, "end of all targets")


def test_a_single_long_frame_does_not_flatten_the_processing_times(
    shown, multi_tracker, client, images
):
    page, show_until = shown
    paths, top = page.locator("#plot-processing path"), page.locator("#plot-processing .slot span")
    stamps = map(client.at, itertools.count(100_000))

    def line():
        return "".join(paths.evaluate_all("all => all.map(path => path.getAttribute('d'))"))

    def touches_top():
        return re.search(r"[ V]9\.0(?!\d)", line())

    def show(stamp):
        client.images.publish(client.message(images[0], stamp))
        page.wait_until(lambda: page.stamp == stamp, "picture")

    def shows_peak():
        show(next(stamps))
        return touches_top()

    show_until(lambda: "L" in line(), "line")
    assert not touches_top()
    multi_tracker.is_slow = True
    show(next(stamps))
    # The peak is cut off at the top.
    page.wait_until(shows_peak, "peak")
    assert top.text_content() == "10 ms"


def test_labels_stay_inside_the_picture(shown, multi_tracker):
    page, show_until = shown
    multi_tracker.targets = {14: ("person", "tracking"), 24: ("a car", "tracking")}
    texts = page.locator("#targets text")
    show_until(lambda: texts.all_text_contents() == ["14 person", "24 a car"], "other targets")
    ends = "all => all.map(it => it.x.baseVal[0].value + it.getComputedTextLength())"
    assert all(end <= page.size[0] + 1 for end in texts.evaluate_all(ends))
    bottoms = "all => all.map(it => it.y.baseVal[0].value)"
    assert all(bottom <= page.size[1] for bottom in texts.evaluate_all(bottoms))


def test_a_click_on_a_box_selects_its_target_and_beside_all_boxes_none(shown, multi_tracker):
    page, show_until = shown
    overlay = page.locator("#overlay")

    def select_by(action, id):
        action()
        show_until(lambda: overlay.get_attribute("data-selected") == (str(id) if id else ""), id)
        assert multi_tracker.selected == id
        # It alone is drawn stronger and marked in the list.
        assert page.box == (multi_tracker.box(id) if id else None)
        assert page.locator("#halo").is_visible() == bool(id)
        pressed = page.locator("#target-list li", has=page.locator("[aria-pressed=true]"))
        rows = [row.get_attribute("data-id") for row in pressed.all()]
        assert rows == ([str(id)] if id else [])

    def click(x, y):
        return lambda: page.mouse.click(*page.to_screen(x, y))

    select_by(click(12, 7), 1)
    select_by(click(48, 28), 2)
    select_by(click(48, 28), 0)
    select_by(click(12, 7), 1)
    select_by(click(130, 100), 0)
    # A target without a box is selected in the list, and by key.
    row = page.locator("#target-list li[data-id='2'] .choose")
    row.focus()
    select_by(lambda: page.keyboard.press("Enter"), 2)
    select_by(row.click, 0)
    assert multi_tracker.stopped == []


def test_a_list_of_words_is_set(shown, multi_tracker):
    page, _ = shown
    page.locator("#groups summary", has_text="The tracker").click()
    words = page.locator("[id='parameter-detector.labels']")
    assert words.input_value() == "person, car"
    words.fill("truck,  large van,")
    words.press("Enter")
    page.wait_until(
        lambda: multi_tracker.get_parameter("detector.labels").value == ["truck", "large van"],
        "words",
    )
    # The preset's list is empty.
    assert page.locator(".parameter.changed", has=words).count() == 1


def test_each_target_is_stopped_by_its_button_or_by_key(shown, multi_tracker):
    page, show_until = shown
    rows = page.locator("#target-list li")
    page.get_by_role("button", name="Stop 3").click()
    show_until(lambda: rows.count() == 2, "two targets")
    page.get_by_role("button", name="Stop 1 car").focus()
    # A new frame keeps the focus.
    before = page.stamp
    show_until(lambda: page.stamp > before, "next frame")
    page.keyboard.press("Enter")
    show_until(lambda: rows.count() == 1, "one target")
    assert multi_tracker.stopped == [3, 1]
    show_until(lambda: page.locator("#targets rect").count() == 1, "one box")


def test_max_targets_can_be_raised_while_the_tracker_runs(tracker, camera, page, client):
    camera.start_target(page)
    assert page.locator("#targets rect").count() == 0
    assert page.locator("#targets-card").is_hidden()
    assert client.set_parameters(max_targets=4).successful
    page.locator("#targets-card").wait_for()
    page.drag((100.0, 80.0, 30.0, 30.0))
    camera.show_until(lambda: page.text("target-count") == "2 of 4", "second target")
    camera.show_until(lambda: page.locator("#targets rect").count() == 2, "both boxes")
