"""The target of a recording: the given box, its target file, its ground truth."""

import errno
import math
import os
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from common import QUICK, read_boxes

from pf_tracker_ros.recordings import RecordingError, choose_target, open_recording
from pf_tracker_ros.recordings.errors import WRONG_TARGET
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, save_targets


@pytest.fixture
def write_target(moving_square_sequence):
    """Writes the target file of the moving square."""

    def write(text):
        path = moving_square_sequence.parent / "moving_square.target.yaml"
        path.write_text(text)
        return path

    return write


def test_a_box_precedes_the_target_file_and_that_the_truth(moving_square_sequence, write_target):
    recording, folder = open_recording(moving_square_sequence), moving_square_sequence.parent
    assert target_file(folder / "drive.mcap") == folder / "drive.target.yaml"
    (folder / "run.1").mkdir()
    assert target_file(folder / "run.1") == folder / "run.1.target.yaml"
    assert choose_target(recording, None).box is None
    write_target("target_box: [1, 2, 3, 4.5]\nlabel: car")
    target = choose_target(recording, None)
    assert (target.box, target.stamp, target.label) == ((1.0, 2.0, 3.0, 4.5), 0, "car")
    assert choose_target(recording, (5, 6, 7, 8)).box == (5.0, 6.0, 7.0, 8.0)
    write_target("target_box: [1, 2, 3, 4]\nlabel:")
    assert choose_target(recording, None).label == ""


@pytest.mark.parametrize(
    "where",
    [
        "frame: 6",
        f"stamp: {10**9 + 6 * 40_000_000}",
        f"frame: 6  # counted from 0\nstamp: {10**9 + 6 * 40_000_000}  # of that frame",
        "recording: moving_square\nimage_size: [160, 120]\nframe: 6\nstamp: 0",
    ],
)
def test_tracking_begins_on_the_frame_of_the_target(track, write_target, tmp_path, where):
    box = [44.0, 42.0, 24.0, 24.0]
    source = write_target(f"target_box: {box}\n{where}\n").with_name("moving_square")
    assert track(source, "--output", tmp_path / "out", *QUICK)[0] == 0
    found = read_boxes(tmp_path / "out")
    assert [row["state"] for row in found[:6]] == ["idle"] * 6
    assert {row["x"] for row in found[:6]} == {""}
    assert [float(found[6][name]) for name in ("x", "y", "width", "height")] == box
    assert math.isclose(float(found[-1]["x"]), 96.0, abs_tol=3)


def test_the_truth_begins_where_the_target_appears(track, moving_square, write_sequence,
                                                   tmp_path):  # fmt: skip
    boxes = moving_square.boxes.copy()
    boxes[:3] = np.nan
    source = write_sequence("late", moving_square.images, boxes)
    assert track(source, "--output", tmp_path / "out", *QUICK)[0] == 0
    found = read_boxes(tmp_path / "out")
    assert [row["state"] for row in found[:4]] == ["idle"] * 3 + ["tracking"]
    assert float(found[3]["x"]) == moving_square.boxes[3][0]
    recording = open_recording(write_sequence("empty", moving_square.images, boxes * np.nan))
    with pytest.raises(RecordingError, match="the ground truth has no box in any frame"):
        raise choose_target(recording, None).not_found_error()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("recording: other.mcap\ntarget_box: [1, 2, 3, 4]", "is for 'other.mcap', not for 'mov"),
        ("image_size: [640, 480]\ntarget_box: [1, 2, 3, 4]", "for images of 640 x 480 px, but the"),
        ("target_box: [20, 30, 24, 24]\nstamp: 1000000007", "with stamp 1000000007 ns, which this"),
        ("target_box: [1, 2, 3, 4]\nframe: 3\nstamp: 7", "with number 3 and stamp 7 ns, which"),
        ("label: car", "'target_box' is None; allowed: four numbers"),
        ("target_box: [1, 2, .nan, 3]", "allowed: four numbers"),
        ("target_box: [1, 2, 3, 0]", "allowed: a width and height above 0"),
        ("target_box: [1, 2, 3, 4]\nstamp: soon", "'stamp' is 'soon'"),
        ("target_box: [1, 2, 3, 4]\nframe: -1", "'frame' is -1"),
        ("target_box: [1, 2, 3, 4]\nage: 3", "unknown key age; allowed: frame, image_size"),
        ("- 1", "the document is [1]; allowed: a mapping"),
        ("target_box: [", "cannot be read as YAML"),
        ("target_box: [900, 2, 3, 4]", "target refused"),
        (f"target_box: [{10**400}, 2, 3, 4]", "allowed: four numbers"),
        (f"target_box: [1, 2, 3, 4]\nimage_size: [{10**400}, 4]", "allowed: two whole numbers"),
        ("target_box: [1, 2, 3, 4]\nimage_size: [320.7, 240]", "'image_size' is [320.7, 240]; all"),
        ("target_box: [1, 2, 3, 4]\nlabel: [a, b]", "'label' is ['a', 'b']; allowed: a text"),
        ("target_box: [1.0e+308, 2, 1.0e+308, 4]", "expected four finite numbers"),
        ("target_box: [&a [1, 2], *a, *a]", "aliases, such as *name, are not allowed"),
        (f"target_box: [{', '.join(['[x]'] * 500)}]", "['x'], ['x...; allowed: four numbers"),
        ("[" * 60 + "]" * 60, "cannot be read as YAML (lists or mappings are nested more than 50"),
        ('target_box: [1, 2, 3, 4]\nlabel: "\\ud800"', r"'label' is '\ud800'; allowed: Unicode"),
        ("label: !!bool perhaps", "cannot be read as YAML"),
    ],
)
def test_a_target_file_that_is_invalid_or_of_another_recording(refusal, write_target, text, said):
    path = write_target(text)
    error = refusal(path.with_name("moving_square"), *QUICK, expected=WRONG_TARGET)
    assert str(path) in error
    assert said in error
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("leads_to", "reason"),
    [("moving_square.target.yaml", "Too many levels"), ("nowhere", "No such file")],
)
def test_a_target_file_that_is_a_broken_link_is_told(
    refusal, moving_square_sequence, leads_to, reason
):
    path = target_file(moving_square_sequence)
    path.symlink_to(leads_to)
    error = refusal(moving_square_sequence, *QUICK, expected=WRONG_TARGET)
    assert f"target file {path} cannot be read ({reason}" in error


def test_boxes_have_the_precision_of_a_message_and_may_overflow(moving_square_sequence):
    recording = open_recording(moving_square_sequence)
    frame = next(recording.frames())
    box = choose_target(recording, (20.1, 30.3, 24.7, 23.9)).box_in(frame)
    left, top, right, bottom = map(float, np.float32([20.1, 30.3, 20.1 + 24.7, 30.3 + 23.9]))
    assert box == (left, top, right - left, bottom - top)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        box = choose_target(recording, (1e308, 2, 1e308, 4)).box_in(frame)
    assert box is not None
    assert not np.isfinite(box).all()


@pytest.fixture
def drawn():
    return [Target((1.0, 2.0, 30.0, 40.0), 7, 3, (160, 120))]


def test_a_target_file_that_is_a_link_stays_one(tmp_path, drawn, monkeypatch):
    kept = tmp_path / "kept.yaml"
    kept.write_text("target_box: [9, 9, 9, 9]\n")
    link = tmp_path / "drive.target.yaml"
    link.symlink_to(kept)
    with pytest.raises(FileExistsError):
        save_targets(drawn, tmp_path / "drive.mcap")
    assert save_targets(drawn, tmp_path / "drive.mcap", may_replace=True) == link
    assert link.is_symlink()
    assert "target_box: [1.0, 2.0, 30.0, 40.0]" in kept.read_text()

    def fail(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    # What cannot be written leaves nothing behind.
    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(OSError, match="No space left"):
        save_targets(drawn, tmp_path / "other.mcap", may_replace=True)
    assert sorted(tmp_path.iterdir()) == [link, kept]


@pytest.mark.parametrize("kind", ["pipe", "link to a pipe", "folder", "link to itself"])
def test_what_is_no_file_is_not_written_over(tmp_path, drawn, kind):
    path = tmp_path / "drive.target.yaml"
    pipe = path if kind == "pipe" else tmp_path / "pipe"
    os.mkfifo(pipe)
    if kind == "folder":
        path.mkdir()
    elif kind != "pipe":
        path.symlink_to(path if kind == "link to itself" else pipe)
    before = path.lstat()
    with pytest.raises(FileExistsError, match="not a regular file"):
        save_targets(drawn, tmp_path / "drive.mcap", may_replace=True)
    assert (path.lstat().st_mode, path.lstat().st_ino) == (before.st_mode, before.st_ino)
    assert pipe.is_fifo()


def test_a_video_keeps_its_size_if_images_change(tmp_path, track, write_images_bag, moving_square):
    larger = [cv2.resize(image, None, fx=2, fy=2) for image in moving_square.images[10:]]
    bag = write_images_bag("drive", [*moving_square.images[:10], *larger])
    box = ("--box", "20,30,24,24")
    assert track(bag, "--output", tmp_path / "out", *box, *QUICK, "--video")[0] == 0
    capture = cv2.VideoCapture(str(tmp_path / "out" / "overlay.mp4"))
    shapes = []
    while (read := capture.read())[0]:
        shapes.append(read[1].shape)
    assert shapes == [(120, 160, 3)] * 20
