"""YOLO's labels: what this project, CVAT and Ultralytics write."""

import math
import zipfile

import pytest
import yaml

from pf_tracker_ros.formats import (
    FORMATS,
    BoxTrack,
    FormatError,
    LabeledBox,
    RecordingInfo,
    read_tracks,
)

SIZE = (640, 480)
INFO = RecordingInfo("drive.mp4", 20, {0: SIZE})


def write(path, tracks):
    FORMATS["yolo"]["boxes.yolo.zip"](path, tracks, INFO)
    return path


def read(path):
    return read_tracks(path, lambda: INFO)


@pytest.fixture
def folder(tmp_path):
    """A function that writes texts into a folder, name to text."""

    def make(**texts):
        for name, text in texts.items():
            file = tmp_path / "labels" / name.replace("__", ".")
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
        return tmp_path / "labels"

    return make


def test_shares_are_of_the_image_of_each_frame(tmp_path):
    car = {frame: LabeledBox((16.0, 12.0, 32.0, 24.0)) for frame in (0, 1, 2)}
    info = RecordingInfo("drive.mp4", 3, {0: (64, 48), 2: (128, 96)})
    FORMATS["yolo"]["boxes.yolo.zip"](tmp_path / "a.zip", [BoxTrack(1, "car", car)], info)
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        texts = [archive.read(f"labels/drive_00000{frame}.txt").decode() for frame in car]
    large, small = "0 0.5000000 0.5000000 0.5000000 0.5000000\n", "0 0.25"
    assert texts[:2] == [large, large]
    assert texts[2].startswith(small)
    (track,) = read_tracks(tmp_path / "a.zip", lambda: info)
    assert {frame: one.box for frame, one in track.boxes.items()} == {
        frame: pytest.approx(one.box, abs=1e-3) for frame, one in car.items()
    }


def test_an_archive_has_a_text_for_each_frame_as_for_training(tmp_path):
    car = {3: LabeledBox((160.0, 120.0, 320.0, 240.0)), 4: LabeledBox(None)}
    tracks = [BoxTrack(7, "car", car), BoxTrack(9, "", {3: LabeledBox((0.0, 0.0, 64.0, 48.0))})]
    path = write(tmp_path / "boxes.yolo.zip", tracks)
    with zipfile.ZipFile(path) as archive:
        texts = {name: archive.read(name).decode() for name in archive.namelist()}
    assert texts.keys() == {"data.yaml", "classes.txt", "labels/drive_000003.txt"}
    assert texts["labels/drive_000003.txt"].splitlines() == [
        "0 0.5000000 0.5000000 0.5000000 0.5000000",
        "1 0.0500000 0.0500000 0.1000000 0.1000000",
    ]
    assert texts["classes.txt"] == "car\ntarget\n"
    described = yaml.safe_load(texts["data.yaml"])
    assert described == {
        "path": ".",
        "train": "images",
        "val": "images",
        "names": {0: "car", 1: "target"},
    }


def test_one_box_of_each_class_reads_back(tmp_path):
    boxes = {frame: LabeledBox((10.125 + frame, 20.5, 33.3, 44.4)) for frame in (0, 1, 5)}
    path = write(tmp_path / "b.zip", [BoxTrack(4, 'a "b" c', boxes)])
    (track,) = read(path)
    assert (track.id, track.label) == (0, 'a "b" c')
    assert list(track.boxes) == [0, 1, 5]
    for frame, labeled in boxes.items():
        assert track.boxes[frame].box == pytest.approx(labeled.box, abs=1e-3)


def test_two_boxes_of_a_class_need_track_ids(folder):
    two = "0 0.5 0.5 0.1 0.1\n0 0.2 0.2 0.1 0.1\n"
    with pytest.raises(FormatError, match=r"line 2: .*; write track ids, or one box of each class"):
        read(folder(a_000000__txt=two))


def test_ultralytics_tracks_have_ids_and_confidences_and_frames_from_1(folder):
    text = "2 0.5 0.5 0.1 0.1 0.75 11\n2 0.2 0.2 0.1 0.1 0.5 12\n"
    path = folder(drive_1__txt=text, drive_12__txt=text, data__yaml="names: [cat, dog, car]")
    one, other = read(path)
    assert (one.id, other.id, one.label) == (11, 12, "car")
    assert list(one.boxes) == [0, 11]
    assert one.boxes[0].box == pytest.approx((288.0, 216.0, 64.0, 48.0))
    assert one.boxes[0].confidence == 0.75


def test_a_sixth_column_is_an_id_if_it_is_whole_everywhere(folder):
    (track,) = read(folder(a_00__txt="0 0.5 0.5 0.1 0.1 3\n", a_01__txt="0 0.5 0.5 0.1 0.1 3\n"))
    assert (track.id, track.label) == (3, "class 0")
    assert math.isnan(track.boxes[0].confidence)
    (track,) = read(folder(a_01__txt="0 0.5 0.5 0.1 0.1 0.25\n"))
    assert (track.id, track.boxes[1].confidence) == (0, 0.25)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 0.5 0.5 0.1", "it has 4 columns; allowed: 5"),
        ("0 0.5 0.5 0.1 nan", "the height is 'nan'"),
        ("0 0.5 0.5 0.1 0", "allowed: width and height above 0"),
        ("x 0.5 0.5 0.1 0.1", "the class is 'x'"),
        ("3 0.5 0.5 0.1 0.1", "the class is 3; allowed: 0 to 1"),
        ("0 0.5 0.5 0.1 0.1 1 2 3", "it has 8 columns"),
    ],
)
def test_invalid_lines_are_refused_with_their_place(folder, line, message):
    path = folder(a_000004__txt=f"\n{line}\n", classes__txt="cat\ndog\n")
    with pytest.raises(FormatError, match=r"a_000004\.txt, line 2: ") as error:
        read(path)
    assert message in str(error.value)


def test_what_cannot_be_read_is_refused(tmp_path, folder):
    with pytest.raises(FormatError, match="it is read with its recording"):
        read_tracks(folder(a_000001__txt="0 0.5 0.5 0.1 0.1"))
    with pytest.raises(FormatError, match="aliases"):
        read(folder(data__yaml="names: [&a b, *a]"))
    with pytest.raises(FormatError, match="has no box"):
        read(folder(a_000001__txt="", data__yaml="names: [car]"))
    path = write(tmp_path / "damaged.zip", [BoxTrack(1, "car", {0: LabeledBox((1, 2, 30, 40))})])
    content = bytearray(path.read_bytes())
    start = content.index(b"labels/") + 28
    content[start : start + 20] = bytes(20)
    path.write_bytes(content)
    with pytest.raises(FormatError, match="cannot be read"):
        read(path)
