"""Files of other programs, and invalid ones."""

import json

import pytest

from pf_tracker_ros.formats import FormatError, read_tracks


@pytest.fixture
def read(tmp_path):
    """Writes a text, with a file beside it, and reads it."""

    def run(text, **others):
        for name, content in others.items():
            (tmp_path / f"{name}.txt").write_text(content)
        path = tmp_path / "drive.txt"
        path.write_text(text if isinstance(text, str) else json.dumps(text))
        return read_tracks(path)

    return run


def test_mot_ground_truth_with_the_labels_of_cvat(read):
    one, other = read("1,2,11,21.5,30,40,1,2,0.2\n1,3,1,1,5,5,1,1,1\n", labels="dog\ncat\n")
    assert (one.label, other.label) == ("cat", "dog")
    assert one.boxes[0].box == (10.0, 20.5, 30.0, 40.0)
    assert one.boxes[0].occluded
    assert not other.boxes[0].occluded


def test_mot_results_without_classes_or_with_a_label(read):
    (track,) = read("3, 7, 1, 1, 30, 40, 0.5, -1, -1, -1\n")
    assert (track.id, track.label, track.boxes[2].confidence) == (7, "", 0.5)
    assert not track.boxes[2].occluded
    (track,) = read("3,7,1,1,30,40,0.5,person\n")
    assert track.label == "person"


def test_kitti_labels(read):
    (car,) = read(
        "0 -1 DontCare -1 -1 -10 219.3 188.5 245.5 218.6 -1000 -1000 -1000 -10 -1 -1 -1\n"
        "0 2 Car 0 1 -1.79 296.7 161.8 455.2 292.4 2 1.8 4.4 -4.6 1.9 13.4 -2.1\n"
    )
    assert (car.id, car.label, car.boxes[0].occluded) == (2, "Car", True)
    assert car.boxes[0].box == pytest.approx((296.7, 161.8, 158.5, 130.6))


CAR = {"category_id": 1, "attributes": {"occluded": True, "track_id": 0, "keyframe": True}}
COCO = {
    "images": [{"id": 5 + n, "file_name": f"a/frame_00000{n}.PNG"} for n in range(3)],
    "categories": [{"id": 1, "name": "car"}],
    "annotations": [
        {"image_id": 5, "bbox": [1, 2, 3, 4], **CAR},
        {
            **{"image_id": 7, "category_id": 1, "bbox": [2, 2, 3, 4]},
            "attributes": {"occluded": False, "track_id": 0, "keyframe": False},
        },
    ],
}


def test_coco_as_cvat_exports_it(read):
    (track,) = read(COCO)
    assert (track.id, track.label) == (0, "car")
    boxes = {frame: labeled.box for frame, labeled in track.boxes.items()}
    assert boxes == {0: (1.0, 2.0, 3.0, 4.0), 1: None, 2: (2.0, 2.0, 3.0, 4.0)}
    assert [track.boxes[frame].is_keyframe for frame in (0, 2)] == [True, False]


def test_coco_with_frame_ids_and_instances(read):
    images = [{"id": 1, "frame_id": 30, "video_id": 1}]
    annotations = [{"image_id": 1, "instance_id": 4, "bbox": [0, 0, 1, 1]}]
    (track,) = read({"images": images, "annotations": annotations})
    assert (track.id, track.label, [*track.boxes]) == (4, "", [30])


def test_boxes_csv(read):
    (track,) = read(
        "frame,stamp,id,x,y,width,height,state,confidence\n"
        "0,10,1,,,,,idle,\n1,20,1,1.5,2,3,4,tracking,0.9\n2,30,1,,,,,lost,0.1\n3,40,1,,,,,skipped,\n"
    )
    assert {frame: one.box for frame, one in track.boxes.items()} == {
        1: (1.5, 2.0, 3.0, 4.0),
        2: None,
    }


def edited(**changes):
    return {**COCO, **changes}


def with_box(*box):
    return edited(annotations=[{"image_id": 5, "track_id": 1, "bbox": [*box]}])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("hello", "begins with 'hello'; allowed: boxes.csv"),
        ("1,1,1,1,5\n", "line 1: it has 5 columns"),
        ("1,1,1,1,5,5\n0,1,1,1,5,5\n", "line 2: the frame is '0'; allowed: whole numbers from 1"),
        ("1,1,1,1,5,5\n1,1,1,1,5,5\n", "line 2: track 1 has a second box"),
        ("1,1,1,1,0,5\n", "line 1: the box is 0 x 5 px"),
        ("1,1,1,inf,5,5\n", "line 1: y is 'inf'"),
        ("1e300,1,1,1,5,5\n", "line 1: the frame is '1e300'"),
        ('1,1,1,1,5,5,1,"car\n', "line 1: "),
        ("0 1 Car 0 0\n", "line 1: it has 5 columns; allowed in KITTI tracking: 17"),
        ("frame,id,x,y,width,height\n0,1,1,1,5\n", "line 2: height is ''"),
        ("frame,id,x,y,width,height\n0,1,1,1,5,5,6\n", "line 2: it has more columns"),
        ("{", "cannot be read as JSON"),
        pytest.param("[" * 100_000, "cannot be read as JSON", id="deeply nested"),
        ("[]", "'images' is NoneType"),
        (edited(images=[{"id": 1}]), "'images' entry 0: it has no frame"),
        (edited(images=[{"id": [1], "frame_id": 0}]), r"'images' entry 0: 'id' is \[1\]"),
        (edited(annotations=[{"image_id": 9}]), "'annotations' entry 0: 'image_id' is 9, which no"),
        (edited(annotations=[{"image_id": 5, "bbox": [0, 0, 1, 1]}]), "it has no 'track_id'"),
        (with_box(0, 0, "a", 1), "the width is 'a'"),
        (edited(annotations=[{"image_id": 5, "track_id": 1}]), "'bbox' is None"),
        (with_box(0, 0, 1, 10**400), "the height is 1000"),
        (edited(annotations=[]), "no box"),
        (edited(images=[{"id": n, "video_id": n, "frame_id": 0} for n in (1, 2)]), "of 2 videos"),
    ],
)
def test_invalid_files_are_refused(read, text, message):
    with pytest.raises(FormatError, match=message) as refusal:
        read(text)
    assert "drive.txt" in str(refusal.value)


def test_a_class_without_its_label_is_refused(read):
    with pytest.raises(FormatError, match="line 1: the class is 3; allowed by the labels file"):
        read("1,1,1,1,5,5,1,3,1\n", labels="dog\ncat\n")


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        read_tracks(tmp_path / "missing.txt")
    with pytest.raises(FormatError, match="is a folder"):
        read_tracks(tmp_path)
    (tmp_path / "bytes.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="cannot be read as text"):
        read_tracks(tmp_path / "bytes.txt")
