"""Unreadable sources raise a one-sentence error at once."""

import json
import os
import socket
from pathlib import Path

import pytest

from pf_tracker_ros.footage import FootageError, is_bag, open_bag, open_footage

pytestmark = pytest.mark.usefixtures("no_hang")

IMAGE = "sensor_msgs/msg/Image"


def open_any(path):
    """Open a source as the replay does, whatever it is."""
    if is_bag(path):
        return list(open_bag(path).images())
    return list(open_footage(path).frames())


@pytest.fixture
def special(tmp_path):
    """Function that makes a FIFO, device or socket."""
    sockets = []

    def make(path: Path, kind: str) -> Path:
        if kind == "FIFO":
            os.mkfifo(path)
        elif kind == "device":
            path.symlink_to("/dev/zero")
        else:
            sockets.append(socket.socket(socket.AF_UNIX))
            sockets[-1].bind(str(path))
        return path

    yield make
    for each in sockets:
        each.close()


@pytest.fixture
def sequence(tmp_path, pictures, write_images):
    folder = tmp_path / "walk"
    write_images(folder / "img", {f"{index}.png": pictures[index] for index in range(2)})
    (folder / "groundtruth.txt").write_text("1,2,3,4\n1,2,3,4\n")
    return folder


@pytest.mark.parametrize("name", ["movie.mp4", "talk.mcap", "talk.db3"])
@pytest.mark.parametrize("kind", ["FIFO", "device", "socket"])
def test_a_source_that_is_no_regular_file_is_refused(tmp_path, special, name, kind):
    path = special(tmp_path / name, kind)
    with pytest.raises(FootageError, match=rf"{name} is a {kind}; accepted are regular files"):
        open_any(path)


@pytest.mark.parametrize(
    "part", ["img/1.png", "groundtruth.txt", "groundtruth_rect.txt", "meta.json", "all.avi"]
)
@pytest.mark.parametrize("kind", ["FIFO", "socket"])
def test_a_part_of_a_sequence_that_is_no_regular_file_is_refused(sequence, special, part, kind):
    path = sequence / part
    if part == "groundtruth_rect.txt":
        (sequence / "groundtruth.txt").unlink()
    elif part == "all.avi":
        (sequence / "meta.json").write_text(json.dumps({"video": part}))
    path.unlink(missing_ok=True)
    special(path, kind)
    for source in (sequence, path.parent) if path.suffix == ".png" else (sequence,):
        with pytest.raises(FootageError, match=rf"{path} is a {kind}"):
            open_footage(source)


def test_a_broken_link_among_the_images_is_refused(sequence):
    (sequence / "img" / "1.png").unlink()
    (sequence / "img" / "1.png").symlink_to("gone.png")
    with pytest.raises(FootageError, match=r"image .*1\.png cannot be read \(No such file"):
        open_footage(sequence / "img")


@pytest.fixture
def write_talk(write_bag, make_message):
    """Write a bag of one image."""

    def write(path: Path, storage="MCAP") -> Path:
        return write_bag(path, [("/image", IMAGE, 5, make_message(IMAGE, 5))], storage)

    return write


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("part", ["metadata.yaml", "talk"])
def test_a_part_of_a_bag_that_is_no_file_is_refused(tmp_path, write_talk, special, storage, part):
    bag = write_talk(tmp_path / "talk", storage)
    (path,) = (each for each in bag.iterdir() if each.name.startswith(part))
    path.unlink()
    special(path, "FIFO")
    with pytest.raises(FootageError, match=rf"bag file {path} is a FIFO"):
        open_any(bag)


@pytest.fixture
def readable_sources(public_folder, pictures, write_video, write_images, write_talk):
    """One source of every kind, opened once."""
    write_images(public_folder / "walk" / "img", {"1.png": pictures[0]})
    (public_folder / "walk" / "groundtruth.txt").write_text("1,2,3,4\n")
    write_video(public_folder / "movie.avi", pictures)
    write_talk(public_folder / "talk")
    for name in ("walk", "walk/img", "movie.avi", "talk", "talk/talk.mcap"):
        open_any(public_folder / name)
    return public_folder


@pytest.mark.parametrize(
    ("locked", "source"),
    [
        ("movie.avi", "movie.avi"),
        ("walk", "walk"),
        ("walk/groundtruth.txt", "walk"),
        ("walk/img", "walk"),
        ("walk/img", "walk/img"),
        ("walk/img", "walk/img/1.png"),
        ("walk/img/1.png", "walk/img"),
        ("talk", "talk"),
        ("talk/metadata.yaml", "talk"),
        ("talk/talk.mcap", "talk"),
        ("talk/talk.mcap", "talk/talk.mcap"),
    ],
)
def test_a_missing_permission_is_reported(readable_sources, ordinary_user, locked, source):
    path = readable_sources / locked
    path.chmod(0)
    try:
        with ordinary_user(), pytest.raises(FootageError, match="may not be read by this user"):
            open_any(readable_sources / source)
    finally:
        path.chmod(0o755)


def test_a_folder_that_cannot_be_entered_and_a_permission_that_is_lost_are_reported(
    readable_sources, ordinary_user
):
    footage, images = open_footage(readable_sources / "walk"), readable_sources / "walk" / "img"
    (images / "1.png").chmod(0)
    with ordinary_user(), pytest.raises(FootageError, match=r"1\.png may not be read"):
        next(footage.frames())
    # It can still be listed.
    images.chmod(0o444)
    with ordinary_user(), pytest.raises(FootageError, match="may not be read by this user"):
        open_footage(images)
