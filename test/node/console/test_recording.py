"""A recording played to the tracker from the page."""

import re
import shutil
import signal

import cv2
import numpy as np
import pytest
import yaml
from console_pages import stamp_at

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.node.console import frame_synchronizer
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters


def boxes_in_lockstep(images, box, first):
    """Boxes of the library for the frames from the first on, each processed once."""
    session = Session(preset_parameters("default"), seed=0)
    session.request(box, stamp_at(first))
    return {
        stamp_at(index): session.process(Frame(image.copy(), stamp_at(index))).estimate.box
        for index, image in enumerate(images)
        if index >= first
    }


@pytest.fixture
def player(player):
    """It with what is used less often unfolded."""
    player.show_more()
    return player


def go_to(page, index):
    page.locator("#seek").fill(str(index))
    page.at_frame(index)


def test_seeking_gives_the_boxes_of_a_run_in_lockstep(player, moving_square):
    go_to(player, 4)
    box = player.draw(moving_square.boxes[4])
    expected = boxes_in_lockstep(moving_square.images, box, 4)
    for index in (15, 7, 19, 5, 4):
        go_to(player, index)
        assert player.box == pytest.approx(expected[stamp_at(index)], abs=2e-3), index
    # Before its frame there is no target; it starts there again.
    assert "accepted" in player.text("note")
    go_to(player, 2)
    assert player.box is None
    begins = "the target begins at frame 4, where it was drawn"
    player.wait_until(lambda: player.text("note") == begins, "where it begins")
    for index in (3, 4, 5, 6):
        player.locator("#forward").click()
        player.at_frame(index)
    assert player.box == pytest.approx(expected[stamp_at(6)], abs=2e-3)
    # The number follows the slider while it moves.
    slider = player.locator("#seek")
    slider.evaluate("(it) => { it.value = 7; it.dispatchEvent(new Event('input')); }")
    assert player.text("frame") == "7 / 19"
    assert player.stamp == stamp_at(6)
    slider.evaluate("(it) => it.dispatchEvent(new Event('change'))")
    player.at_frame(7)


def test_the_last_request_during_a_seek_counts(graph, start_console, open_page, bag):
    tracker = graph.process("-p", "seed:=0")
    page = open_page(start_console(source=str(bag)).url)
    page.at_frame(0)
    tracker.send_signal(signal.SIGSTOP)
    page.locator("#seek").fill("5")
    page.locator("#seek").blur()
    page.keyboard.press("Space")
    page.wait_until(lambda: page.text("play-word") == "Pause", "that it will play")
    page.keyboard.press("n")
    page.wait_until(lambda: page.text("play-word") == "Play", "that it will not")
    page.keyboard.press("n")
    tracker.send_signal(signal.SIGCONT)
    page.at_frame(7)
    page.keyboard.press("n")
    page.at_frame(8)


def test_the_box_returns_with_a_tracker_that_was_silent(
    graph, start_console, open_page, bag, moving_square
):
    tracker = graph.process("-p", "seed:=0")
    page = open_page(start_console(source=str(bag)).url)
    page.at_frame(0)
    box = page.draw(moving_square.boxes[0])
    tracker.send_signal(signal.SIGSTOP)
    page.wait_for_text("health", "is silent")
    assert page.box is None
    tracker.send_signal(signal.SIGCONT)
    page.wait_until(lambda: page.box, "box of the still picture")
    assert tuple(page.box) == box


def test_it_pauses_at_its_end_and_can_go_back(player, moving_square):
    box = player.draw(moving_square.boxes[0])
    expected = boxes_in_lockstep(moving_square.images, box, 0)
    player.locator("#speed").select_option("4")
    player.keyboard.press("Space")
    for _ in range(2):
        player.at_frame(19)
        player.wait_until(lambda: player.text("play-word") == "Play", "pause at the end")
        assert player.box == pytest.approx(expected[stamp_at(19)], abs=2e-3)
        # Played again, it begins anew.
        player.locator("#speed").select_option("1")
        player.keyboard.press("Space")
        player.wait_until(lambda: player.stamp < stamp_at(19), "beginning")
    player.at_frame(19)
    player.wait_until(lambda: player.text("play-word") == "Play", "pause at the end")
    player.locator("#back").click()
    player.at_frame(18)
    assert player.box == pytest.approx(expected[stamp_at(18)], abs=2e-3)


def test_stop_removes_a_target_that_waits_for_its_frame(player, moving_square):
    go_to(player, 4)
    player.draw(moving_square.boxes[4])
    go_to(player, 2)
    player.keyboard.press("s")
    removed = "the target of frame 4 is removed; waiting for a target"
    player.wait_until(lambda: player.text("note") == removed, "response")
    for index in (3, 4, 5):
        player.keyboard.press("n")
        player.at_frame(index)
        assert player.box is None, index


def test_the_target_is_saved_beside_the_recording(player, moving_square, bag):
    go_to(player, 3)
    box = player.draw(moving_square.boxes[3])
    player.locator("#save").click()
    player.wait_for_text("note", "drive.target.yaml")
    saved = yaml.safe_load((bag.parent / "drive.target.yaml").read_text())
    assert saved == {
        "target_box": pytest.approx(box, abs=1e-2),
        "frame": 3,
        "stamp": stamp_at(3),
        "recording": "drive",
        "image_size": [160, 120],
    }
    assert [path.name for path in bag.parent.iterdir() if path.name.startswith(".")] == []
    # The clicked button keeps no focus, unlike one that was focused by key.
    player.keyboard.press(" ")
    player.at_frame(19)
    player.locator("#back").focus()
    for index in (18, 17):
        player.keyboard.press(" ")
        player.at_frame(index)


@pytest.fixture
def player_of_several(graph, client, start_console, open_page, bag):
    """A page with the recording at its first frame, and a tracker of up to two targets."""
    graph.tracker(client, max_targets=2)
    page = open_page(start_console(source=str(bag)).url)
    page.at_frame(0)
    page.show_more()
    return page


@pytest.fixture
def player_of_two(player_of_several):
    """The same with two targets."""
    page = player_of_several
    page.locator("#targets-card").wait_for()
    for count in (1, 2):
        page.drag((40.0 * count, 30.0, 24.0, 24.0))
        page.wait_until(lambda: page.text("target-count") == f"{count} of 2", "target")  # noqa: B023
        # The boxes are drawn with the next picture.
        page.wait_until(lambda: page.locator("#targets rect").count() == count, "box")  # noqa: B023
        assert page.text("frame") == "0 / 19"
    return page


def test_several_targets_keep_their_ids_after_a_seek_and_a_step_back(player_of_two):
    page = player_of_two
    texts = page.locator("#targets text")

    def shows_both(frame):
        return page.stamp == stamp_at(frame) and texts.all_text_contents() == ["1", "2"]

    for frame in (1, 2, 3):
        page.keyboard.press("n")
        page.wait_until(lambda: shows_both(frame), "next frame")  # noqa: B023
    page.keyboard.press("ArrowLeft")
    page.wait_until(lambda: shows_both(2), "frame before")
    page.keyboard.press("n")
    page.wait_until(lambda: shows_both(3), "frame after")
    page.locator("#seek").fill("1")
    page.wait_until(lambda: shows_both(1), "sought frame")
    # An earlier moment has its own message.
    page.locator("#forward").click()
    page.wait_until(lambda: shows_both(2), "next frame")
    page.keyboard.press("s")
    page.wait_until(lambda: page.text("health").startswith("waiting for a target"), "news")
    page.keyboard.press("ArrowLeft")
    page.wait_until(lambda: page.text("health") == "tracking 2 targets", "message of that moment")
    assert shows_both(1)
    page.keyboard.press("Escape")
    page.wait_until(lambda: page.text("health").startswith("waiting for a target"), "the newest")


def test_boxes_do_not_blink_while_a_recording_plays(player_of_two, monkeypatch):
    page = player_of_two
    # Each status counts as late, as on a busy machine.
    monkeypatch.setattr(frame_synchronizer, "_SILENCE", 0.0)
    page.evaluate(
        """() => {
          const targets = document.getElementById("targets");
          window.fewest = targets.childElementCount;
          new MutationObserver(() => {
            window.fewest = Math.min(window.fewest, targets.childElementCount);
          }).observe(targets, { childList: true });
        }"""
    )
    page.locator("#play").click()
    page.wait_until(lambda: page.stamp == stamp_at(19), "last frame")
    page.wait_until(lambda: page.locator("#targets rect").count() == 2, "boxes")
    assert page.evaluate("window.fewest") == 2


def test_in_a_paused_recording_a_click_selects_at_once(player_of_two):
    page = player_of_two
    overlay, halo = page.locator("#overlay"), page.locator("#halo")
    for id, x in (("1", 50.0), ("2", 90.0), ("", 90.0), ("2", 90.0)):
        page.mouse.click(*page.to_screen(x, 42.0))
        page.wait_until(lambda: overlay.get_attribute("data-selected") == id, "selection")  # noqa: B023
        assert halo.is_visible() == bool(id)
    page.keyboard.press("n")
    page.at_frame(1)
    assert overlay.get_attribute("data-selected") == "2"


def test_the_heat_map_needs_a_target_and_comes_with_the_next_frame(player, moving_square):
    player.keyboard.press("h")
    player.wait_for_text("note", "the heat map needs a target")
    player.keyboard.press("h")
    player.draw(moving_square.boxes[0])
    player.keyboard.press("h")
    player.wait_for_text("note", "the heat map comes with the next frame")
    player.keyboard.press("n")
    player.at_frame(1)
    player.locator("#heatmap").wait_for()


def test_several_targets_are_saved_and_loaded(player_of_several, bag):
    page = player_of_several
    page.locator("#targets-card").wait_for()
    assert page.locator("#save").is_disabled()

    def seek(frame, count):
        page.locator("#seek").fill(str(frame))
        page.wait_until(lambda: page.stamp == stamp_at(frame), "frame")
        page.wait_until(lambda: page.text("target-count") == f"{count} of 2", "targets")

    for frame, x in ((0, 40.0), (2, 90.0)):
        seek(frame, int(frame > 0))
        page.drag((x, 30.0, 24.0, 24.0))
        count = f"{1 + (frame > 0)} of 2"
        page.wait_until(lambda: page.text("target-count") == count, "target")  # noqa: B023
    page.locator("#save").click()
    page.wait_for_text("note", "saved as drive.target.yaml")
    saved = yaml.safe_load((bag.parent / "drive.target.yaml").read_text())
    assert [(one["frame"], one["stamp"]) for one in saved["targets"]] == [
        (0, stamp_at(0)),
        (2, stamp_at(2)),
    ]
    assert [one["target_box"][0] for one in saved["targets"]] == pytest.approx([40, 90], abs=0.5)
    # A third one is refused, on the same frame once more, whose result stays.
    page.drag((5.0, 80.0, 24.0, 24.0))
    page.wait_for_text("note", "target refused")
    page.wait_until(lambda: page.text("health") == "tracking 2 targets", "message")
    assert (page.text("target-count"), page.text("state")) == ("2 of 2", "tracking")
    assert page.locator("#targets rect").count() == 2
    page.keyboard.press("Escape")
    page.keyboard.press("s")
    page.wait_for_text("note", "stopped 2 targets")
    page.locator("#load").click()
    page.wait_until(lambda: page.text("target-count") == "1 of 2", "the first of them")
    assert page.stamp == stamp_at(0)
    seek(3, 2)


@pytest.fixture
def saved(bag):
    """A function that writes the target file of the recording."""

    def save(**values):
        (bag.parent / "drive.target.yaml").write_text(yaml.safe_dump(values))

    return save


@pytest.mark.usefixtures("tracker")
def test_a_target_minutes_ahead_waits_for_its_frame(
    write_images, start_console, open_page, moving_square
):
    """Sent earlier, the tracker would refuse it as of another clock."""

    def stamp_in(index):
        return stamp_at(index) + (10**11 if index >= 8 else 0)

    bag = write_images(moving_square.images, stamp_in)
    box = [float(value) for value in moving_square.boxes[15]]
    text = yaml.safe_dump({"target_box": box, "frame": 15, "stamp": stamp_in(15)})
    (bag.parent / "drive.target.yaml").write_text(text)
    page = open_page(start_console(source=str(bag)).url)
    page.wait_until(lambda: page.shows(stamp_in(0)), "first frame")
    page.locator("#speed").select_option("0")
    page.show_more()
    page.locator("#load:enabled").click()
    page.wait_until(lambda: page.shows(stamp_in(15)) and page.box, "box")
    assert page.box == pytest.approx(box, abs=1e-2)
    page.locator("#seek").fill("2")
    page.wait_until(lambda: page.shows(stamp_in(2)), "frame 2")
    assert page.box is None
    page.keyboard.press("Space")
    page.wait_until(lambda: page.shows(stamp_in(19)) and page.box, "box")
    assert "refused" not in page.text("note")
    assert page.locator("#save").is_enabled()


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"target_box": [1, 2, 3, 4], "stamp": 77}, "it belongs to another recording"),
        ({"target_box": [1, 2, 3, 4], "image_size": [640, 480]}, "these have 160 x 120 px"),
    ],
)
def test_an_invalid_or_foreign_target_file_is_refused(player, saved, values, reason):
    # The file replaces one that was saved.
    player.draw((20, 30, 24, 24))
    player.locator("#save").click()
    player.locator("#load:enabled").wait_for()
    saved(**values)
    player.locator("#load").click()
    player.wait_for_text("note", reason)
    player.wait_until(lambda: player.box, "target that was there")


def test_a_click_in_a_recording_becomes_a_target_to_save(player, client):
    client.set_parameters(click_size=24.0)
    player.wait_until(
        lambda: player.locator("[id='parameter-click_size']").input_value() == "24", "its size"
    )
    player.mouse.click(*player.to_screen(32, 42))
    player.wait_until(lambda: player.box, "box")
    assert player.box == pytest.approx([20, 30, 24, 24], abs=1.0)
    player.wait_until(player.locator("#save").is_enabled, "target to save")


def test_the_recording_waits_for_a_tracker_and_advises_on_one_of_another_topic(
    start_console, open_page, bag, graph
):
    page = open_page(start_console(source=str(bag)).url)
    page.wait_until(lambda: page.text("frame") == "0 / 19", "recording")
    assert page.stamp == 0
    remapped = ["--ros-args", "-r", "image:=/camera/image_raw"]
    other = graph.tracker(cli_args=remapped, image_timeout=0.5)
    advice = (
        "waiting for a subscriber of /image; the tracker subscribes to /camera/image_raw: start "
        "the console with --ros-args -r image:=/camera/image_raw"
    )
    page.wait_until(lambda: page.text("problem").endswith(advice), "advice")
    page.wait_until(lambda: page.text("topic").startswith("/camera/image_raw "), "its topic")
    # Missing images are a fault here, although the recording is paused.
    page.wait_until(lambda: page.text("health").startswith("no image for"), "what is missing")
    other.context.try_shutdown()
    graph.tracker()
    page.wait_until(lambda: page.text("problem") == "", "end of it")
    assert page.locator("#problem").is_hidden()
    page.at_frame(0)


def test_an_unplayable_source_is_reported(start_console, capfd):
    node = start_console(source="/nowhere.mcap")
    assert node.exit_code == 1
    errors = capfd.readouterr().err
    assert "there is no /nowhere.mcap" in errors
    assert "/nowhere.mcap cannot be played" in errors


def test_an_unwritable_folder_is_reported(player, moving_square, bag):
    player.draw(moving_square.boxes[0])
    shutil.rmtree(bag.parent)
    player.locator("#save").click()
    player.wait_until(
        lambda: re.search("cannot be saved: .*No such file", player.text("note")), "reason"
    )


def test_a_refused_box_keeps_the_present_target(player, moving_square):
    player.drag((20, 50, 60, 0))
    player.wait_for_text("note", "refused")
    player.keyboard.press("Escape")
    # It is removed.
    assert player.locator("#save").is_disabled()
    box = player.draw(moving_square.boxes[0])
    player.keyboard.press("n")
    player.at_frame(1)
    before = player.box
    player.keyboard.press("r")
    player.locator("#box-x").fill("5000")
    player.locator("#box-x").press("Enter")
    player.wait_for_text("note", "outside the image")
    player.keyboard.press("Escape")
    player.keyboard.press("n")
    player.at_frame(2)
    expected = boxes_in_lockstep(moving_square.images, box, 0)
    assert before == pytest.approx(expected[stamp_at(1)], abs=2e-3)
    assert player.box == pytest.approx(expected[stamp_at(2)], abs=2e-3)


def test_a_broken_recording_is_reported_and_the_page_stays_usable(
    tracker, start_console, open_page, tmp_path
):
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((120, 160, 3), 90, np.uint8))
    (tmp_path / "3.png").write_bytes(b"no image")
    page = open_page(start_console(source=str(tmp_path)).url)
    page.wait_until(lambda: page.text("frame") == "0 / 3", "first frame")
    page.keyboard.press(" ")
    page.wait_for_text("problem", "3.png")
    assert "restart the console" in page.text("problem")
    page.locator("#seek").fill("0")
    page.wait_until(lambda: page.text("connection") == "connected", "the tracker")
