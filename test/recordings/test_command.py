"""The command `track` on a single recording: its files, messages and exit codes."""

import errno
import gc
import os
import re
import signal
import sys
import threading
import time

import cv2
import numpy as np
import pytest
from common import QUICK, TRACK_WITHOUT_ROS, full_disk, one_sentence, read_boxes, run_python

from pf_tracker_ros import Tracker
from pf_tracker_ros.footage import write_footage
from pf_tracker_ros.footage.opening import open_footage
from pf_tracker_ros.recordings.errors import WRONG_TARGET, unwritable

BOX = ("--box", "20,30,24,24")


def hidden(folder):
    return [path.name for path in folder.rglob(".*")]


def test_numbers_are_those_of_the_library(track, moving_square, moving_square_sequence, tmp_path):
    # The label of a single target is no column.
    target = moving_square_sequence.with_name("moving_square.target.yaml")
    target.write_text("target_box: [20, 30, 24, 24]\nlabel: car")
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow")
    given = ("--output", tmp_path / "out", "--seed", 4, "--parquet", "--video")
    code, said, errors = track(moving_square_sequence, *given)
    assert (code, errors) == (0, "")
    assert said.startswith(f"{moving_square_sequence}: 20 frames (100% tracking), ")
    tracker = Tracker.from_preset("default", seed=4)
    found = read_boxes(tmp_path / "out")
    table = parquet.read_table(tmp_path / "out" / "boxes.parquet").to_pylist()
    assert [{name: str(value) for name, value in row.items()} for row in table] == found
    capture = cv2.VideoCapture(str(tmp_path / "out" / "overlay.mp4"))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 20
    assert list(found[0]) == [
        *("frame", "stamp", "id", "x", "y", "width", "height", "state", "confidence")
    ]
    for index, (row, image) in enumerate(zip(found, moving_square.images, strict=True)):
        expected = (
            tracker.update(image, 40_000_000 / 10**9)
            if index
            else tracker.start(image, moving_square.boxes[0])
        )
        assert (row["frame"], row["id"]) == (str(index), "1")
        assert int(row["stamp"]) == 10**9 + index * 40_000_000
        box = tuple(float(row[name]) for name in ("x", "y", "width", "height"))
        assert box == expected.box
        assert float(row["confidence"]) == expected.confidence
        assert row["state"] == expected.state


def test_an_output_that_exists_is_left_alone(track, moving_square_sequence, tmp_path):
    output = tmp_path / "out"
    output.mkdir()
    (output / "boxes.csv").write_text("mine")
    for given, reason in (
        (output, "boxes.csv exists already and is not overwritten; remove it"),
        (output / "boxes.csv", "is not a folder"),
    ):
        code, said, errors = track(moving_square_sequence, "--output", given, *QUICK)
        assert (code, said, reason in one_sentence(errors)) == (4, "", True)
    assert (output / "boxes.csv").read_text() == "mine"


@pytest.mark.parametrize("place", ["", "out", "../link/deeper"])
@pytest.mark.parametrize("option", ["--output", "--report"])
def test_no_output_in_the_recording(track, moving_square_sequence, tmp_path, place, option):
    (tmp_path / "link").symlink_to(moving_square_sequence)
    output = moving_square_sequence / place
    before = sorted(moving_square_sequence.rglob("*"))
    given = ("--output", output) if option == "--output" else ("--output", tmp_path / "apart")
    given += ("--report", output) if option == "--report" else ()
    code, _, errors = track(moving_square_sequence, *given, "--bag")
    assert code == 2
    assert f"the output {output} is in the recording {moving_square_sequence}" in errors
    assert sorted(moving_square_sequence.rglob("*")) == before


def test_a_file_that_appears_meanwhile_stays(start_track, wait_for_rows, long_sequence, tmp_path):
    process = start_track(long_sequence, "--output", "out", *QUICK, "--video")
    wait_for_rows(process, tmp_path / "out", 3)
    (tmp_path / "out" / "overlay.mp4").write_text("mine")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert "overlay.mp4 exists already" in errors
    assert (tmp_path / "out" / "overlay.mp4").read_text() == "mine"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"boxes.csv", "overlay.mp4"}


def test_an_output_that_may_not_or_cannot_be_written_is_told_before_tracking(
    track, ordinary_user, public_folder, moving_square, write_sequence
):
    source = write_sequence("square", moving_square.images, moving_square.boxes, public_folder)
    # The first run imports all modules, which the ordinary user may not read.
    assert track(source, "--output", public_folder / "first", *QUICK)[0] == 0
    locked, closed = public_folder / "locked", public_folder / "closed"
    locked.mkdir(mode=0o555)
    closed.mkdir(mode=0o700)
    denied = "cannot be written (Permission denied); change the permi"
    for output, expected, reason in (
        (locked, 5, denied),
        (locked / "out", 5, denied),
        (closed / "new", 5, ""),
        (public_folder / ("n" * 300), 1, ""),
    ):
        with ordinary_user():
            code, said, errors = track(source, "--output", output, *QUICK)
        assert (code, said) == (expected, "")
        assert one_sentence(errors).startswith("track: error: ")
        assert reason in errors
    assert list(locked.iterdir()) == []


def test_results_before_an_unreadable_frame_are_kept(track, moving_square_sequence, tmp_path):
    (moving_square_sequence / "img" / "0013.png").write_bytes(b"not a picture")
    output = tmp_path / "out"
    asked = (*QUICK, "--video", "--report")
    code, said, errors = track(moving_square_sequence, "--output", output, *asked)
    assert (code, said) == (3, "")
    line = one_sentence(errors)
    assert "0013.png cannot be decoded" in line
    assert line.endswith("; 12 frames were tracked")
    assert len(read_boxes(output)) == 12
    assert cv2.VideoCapture(str(output / "overlay.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 12
    page = (output / "report.html").read_text()
    assert '<td data-figure="frames" data-value="12"' in page
    assert page.count("<figure><img") >= 8


SQUARE, IMAGES = "moving_square", "moving_square/img"


@pytest.mark.parametrize(
    ("source", "arguments", "said"),
    [
        (SQUARE, ["--box", "1,2,3"], "x,y,width,height in pixels"),
        (SQUARE, ["--box", "1,2,0,4"], "width and height above 0"),
        (SQUARE, ["--box", "-1,2,9,9"], "begins with '-' after '=', such as --box=-3,4,50,60"),
        (SQUARE, ["--box", "1,2,nan,4"], "width and height above 0"),
        (SQUARE, [*BOX, "--preset", "best"], "no preset 'best'; there are: default"),
        (SQUARE, [*BOX, "--parameter", "particles=none"], "particles"),
        (SQUARE, [*BOX, "--seed", "-1"], "whole numbers from 0"),
        (SQUARE, [*BOX, "--frame-rate", "0"], "0.01 to 10000"),
        (SQUARE, ["--bag-topic", "/eye"], "--bag-topic applies to bags, and"),
        (IMAGES, [], "; give --box X,Y,W,H for the first frame, draw it with --draw, find targets"),
        ("a.avi", [*BOX, "--frame-rate", "9"], "--frame-rate applies to folders of images, and"),
        # Recordings that cannot be read.
        ("empty.mp4", BOX, "empty.mp4"),
        ("noise.mp4", BOX, "noise.mp4"),
        ("nowhere", BOX, "there is no "),
    ],
)
def test_a_request_that_cannot_be_carried_out(  # noqa: PLR0917
    refusal, moving_square_sequence, write_video, source, arguments, said
):
    folder = moving_square_sequence.parent
    (folder / "empty.mp4").touch()
    (folder / "noise.mp4").write_bytes(b"\x00nothing that is a video")
    write_video(folder / "a.avi", np.zeros((3, 48, 64, 3), np.uint8))
    assert said in refusal(folder / source, *arguments, expected=3 if arguments is BOX else 2)


def test_a_video_is_not_written_to_a_name_that_is_not_utf_8(track, moving_square_sequence):
    output = os.fsdecode(b"\xe4")
    code, _, errors = track(moving_square_sequence, "--video", "--output", output)
    assert (code, "--video cannot write into --output" in one_sentence(errors)) == (2, True)


@pytest.mark.parametrize(
    "missing",
    [
        ("ray", "ray", "--archive", ".", "--ray", "local"),
        ("fsspec", "archives", "--archive", "s3://bucket/fleet"),
        ("aiohttp", "console", IMAGES, "--draw"),
        ("scipy", "targets", IMAGES, "--detector", "motion"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(
    refusal, monkeypatch, moving_square_sequence, missing
):
    package, extra, *arguments = missing
    monkeypatch.chdir(moving_square_sequence.parent)
    monkeypatch.setitem(sys.modules, package, None)
    expected = f"{package} is not installed: pip install {package}, or '.[{extra}]'"
    assert expected in refusal(*arguments)


@pytest.mark.usefixtures("in_this_process")
def test_the_frame_rate_applies_to_the_folders_of_images_of_an_archive(
    track, moving_square, write_video, moving_square_sequence, tmp_path
):
    path = write_video(tmp_path / "drive.avi", moving_square.images)
    path.with_name("drive.target.yaml").write_text("target_box: [20, 30, 24, 24]")
    (tmp_path / "list.txt").write_text(f"{path}\n{moving_square_sequence}\n")
    asked = ("--output", tmp_path / "out", "--frame-rate", "50", *QUICK)
    assert track("--archive", tmp_path / "list.txt", *asked)[0] == 0


def test_a_box_outside_the_image_leaves_nothing_behind(refusal, moving_square_sequence):
    pytest.importorskip("pyarrow", reason="needs pyarrow")
    before = threading.active_count()
    outside = ("--box", "900,30,24,24", "--video", "--bag", "--report", "--parquet")
    error = refusal(moving_square_sequence, *outside, expected=WRONG_TARGET)
    gc.collect()
    assert "frame 0, box from --box: target refused: " in error
    assert threading.active_count() == before


def test_a_signal_leaves_complete_files(start_track, wait_for_rows, long_sequence, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader

    process = start_track(long_sequence, "--output", "out", *QUICK, "--video", "--bag")
    output = tmp_path / "out"
    wait_for_rows(process, output, 10)
    process.send_signal(signal.SIGTERM)
    said, errors = process.communicate(timeout=60)
    assert (process.returncode, said) == (143, "")
    count = len(read_boxes(output))
    assert 10 <= count < 1000
    assert errors == f"track: error: terminated; {count} frames saved\n"
    assert all(row["confidence"] for row in read_boxes(output))
    assert cv2.VideoCapture(str(output / "overlay.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == count
    with Reader(output / "topics.mcap") as reader:
        assert {each.topic: each.msgcount for each in reader.connections}[
            "/pf_tracker/status"
        ] == count
    assert hidden(output) == []


def test_a_killed_process_leaves_no_complete_file(
    start_track, wait_for_rows, long_sequence, tmp_path
):
    process = start_track(long_sequence, "--output", "out", *QUICK, "--video")
    wait_for_rows(process, tmp_path / "out", 10)
    process.kill()
    process.wait()
    assert [path for path in (tmp_path / "out").iterdir() if not path.name.startswith(".")] == []


def test_a_full_disk_keeps_the_rows_before(track, moving_square_sequence, tmp_path):
    with full_disk(1000):
        code, said, errors = track(moving_square_sequence, "--output", tmp_path / "out", *QUICK)
    assert (code, said) == (6, "")
    line = one_sentence(errors)
    assert "boxes.csv cannot be written (File too large); free disk space" in line
    found = read_boxes(tmp_path / "out")
    assert line.endswith(f"; {len(found)} frames were tracked")
    assert 800 < (tmp_path / "out" / "boxes.csv").stat().st_size <= 1000
    assert all(row["confidence"] for row in found)
    assert hidden(tmp_path / "out") == []


@pytest.mark.parametrize("option", ["--video", "--bag"])
def test_a_full_disk_discards_video_or_bag_and_keeps_the_boxes(
    track, moving_square_sequence, option
):
    size, file = {"--video": (5000, "overlay.mp4"), "--bag": (300_000, "topics.mcap")}[option]
    output = moving_square_sequence.parent / "out"
    with full_disk(size):
        code, said, errors = track(moving_square_sequence, "--output", output, *QUICK, option)
    assert (code, said) == (6, "")
    line = one_sentence(errors)
    assert f"{file} cannot be written (" in line
    told = int(line.split("; ")[-1].split()[0])
    # boxes.csv may have one frame more, written before the other file failed.
    assert len(read_boxes(output)) - 1 <= told <= len(read_boxes(output)) <= 20
    assert [path.name for path in output.iterdir()] == ["boxes.csv"]


@pytest.mark.parametrize(
    ("number", "code"), [("ENOSPC", 6), ("EDQUOT", 6), ("EROFS", 5), ("EACCES", 5), ("EIO", 1)]
)
def test_each_error_of_writing_has_its_exit_code(tmp_path, number, code):
    error = OSError(getattr(errno, number), os.strerror(getattr(errno, number)))
    assert unwritable(tmp_path, error).exit_code == code


def test_help_lists_every_exit_code(track):
    said = track("--help")[1]
    codes = {line.split()[0] for line in said.splitlines() if line.split()}
    assert codes >= {*map(str, range(9)), "130", "143"}


@pytest.mark.parametrize("step", [0, -10_000_000])
def test_frames_skipped_for_their_stamps_are_reported(track, write_images_bag, tmp_path, step):
    bag = write_images_bag("drive", np.zeros((4, 120, 160, 3), np.uint8), interval=step)
    as_recorded = ("--as-recorded", *QUICK)
    code, said, errors = track(bag, "--output", tmp_path / "out", *BOX, *as_recorded)
    assert code == 0
    assert "75% skipped" in said
    reason = "is earlier than" if step else "equals"
    assert errors.startswith(f"track: frames were skipped, the first because its stamp {reason} ")
    assert errors.count("\n") == 1


def test_a_bag_in_another_order_is_sorted_and_told(
    track, moving_square, write_images_bag, tmp_path
):
    from rosbags.rosbag2 import Reader

    sorted_bag = write_images_bag("sorted", moving_square.images)
    swapped = write_images_bag("swapped", moving_square.images, [i ^ 1 for i in range(20)])
    outputs = [tmp_path / name for name in ("a", "b", "c")]
    assert track(sorted_bag, "--output", outputs[0], *BOX, *QUICK)[::2] == (0, "")
    code, _, errors = track(swapped, "--output", outputs[1], *BOX, *QUICK, "--bag")
    assert (code, errors.count("\n")) == (0, 1)
    assert errors.startswith(
        "track: 10 frames of swapped were recorded out of order and sorted by "
    )
    assert read_boxes(outputs[1]) == read_boxes(outputs[0])
    # Its results have the log times of the images.
    with Reader(outputs[1] / "topics.mcap") as reader:
        times = {time for _, time, _ in reader.messages()}
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert times == {2 * 10**9 + index for index in range(20)}
    names = ("box", "overlay", "particles", "status")
    assert counts == {f"/pf_tracker/{name}": 20 for name in names}
    code, said, _ = track(swapped, "--output", outputs[2], *BOX, *QUICK, "--as-recorded")
    assert code == 0
    assert "50% skipped" in said


def test_an_image_of_another_size_is_skipped(track, moving_square, write_images_bag, tmp_path):
    images = [*moving_square.images[:10], *moving_square.images[10:, :112, :152]]
    folder = tmp_path / "cropped.images"
    folder.mkdir()
    for index, image in enumerate(images):
        assert cv2.imwrite(str(folder / f"{index}.png"), image)
    bag, outputs = write_images_bag("cropped_bag", images), tmp_path / "outputs"
    for source in (folder, bag):
        code, _, errors = track(source, "--output", outputs / source.stem, *BOX, *QUICK)
        assert (code, errors.count("\n")) == (0, 1)
        assert "the first because image is (112, 152, 3) uint8, but the targets are" in errors
    assert read_boxes(outputs / "cropped") == read_boxes(outputs / "cropped_bag")


def test_it_needs_no_ros(track, moving_square_sequence, tmp_path):
    bag = tmp_path / "drive.mcap"
    write_footage(open_footage(moving_square_sequence), bag, topic="/left/image")
    assert track(bag, "--output", tmp_path / "out", "--bag-topic", "/right/image")[0] == 3
    given = (bag, "--bag-topic", "/left/image", "--output", tmp_path / "out", "--video", "--bag")
    outcome = run_python(TRACK_WITHOUT_ROS, *given, *QUICK)
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("boxes.csv", "overlay.mp4", "topics.mcap")
    }


def test_the_second_ctrl_c_discards_files(start_track, wait_for_rows, long_sequence, tmp_path):
    process = start_track(long_sequence, "--output", "out", *QUICK, "--video", "--report")
    output = tmp_path / "out"
    wait_for_rows(process, output, 30)
    process.send_signal(signal.SIGINT)
    # The report takes a while.
    while not (output / "boxes.csv").exists():
        assert process.poll() is None
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "track: error: interrupted; unfinished files were discarded\n"
    assert hidden(output) == []
    assert not (output / "report.html").exists()


@pytest.fixture(params=["video", "bag"])
def incomplete(request, moving_square, write_video, write_images_bag, tmp_path):
    """A recording without some of its frames, and what is told of it."""
    if request.param == "video":
        source = write_video(tmp_path / "cut.avi", moving_square.images, codec="MJPG")
        source.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
        parts = r"(\d+) of its 20 frames"
    else:
        source = write_images_bag("drive", moving_square.images)
        data = source / "metadata.yaml"
        data.write_text(data.read_text().replace("message_count: 20", "message_count: 23"))
        parts = "(20) of its 23 images on /eye"
    return source, rf"{request.param} {source} is damaged: it contains {parts}"


def test_an_incomplete_recording_is_an_error_unless_that_is_allowed(track, incomplete, tmp_path):
    source, damage = incomplete
    code, said, errors = track(source, *BOX, "--output", tmp_path / "out")
    assert (code, said) == (3, "")
    found = re.fullmatch(rf"track: error: {damage}; (\d+) frames were tracked\n", errors)
    contained, tracked = map(int, found.groups())
    assert 0 < tracked <= contained
    assert len(read_boxes(tmp_path / "out")) == tracked
    allowed = ("--output", tmp_path / "allowed", "--allow-partial")
    code, said, errors = track(source, *BOX, *allowed)
    assert (code, f": {tracked} frames (" in said) == (0, True)
    assert re.fullmatch(f"track: {damage}\n", errors)
