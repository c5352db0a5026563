import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.footage import FootageError, open_footage, read_sequence
from pf_tracker_ros.footage.ground_truth import parse_box

coordinates = st.floats(-1e6, 1e6)
sizes = st.floats(1e-3, 1e6)

BOXES = "1,2,3,4\n2.5,3.5,3,4\n3,4,3,4\n"


@pytest.fixture
def image_sequence(tmp_path, pictures, write_images):
    folder = tmp_path / "walk"
    write_images(folder / "img", {f"{index:04d}.png": pictures[index] for index in range(3)})
    (folder / "groundtruth.txt").write_text(BOXES)
    (folder / "meta.json").write_text(json.dumps({"name": "a walk"}))
    return folder


@given(
    st.tuples(coordinates, coordinates, sizes, sizes),
    st.sampled_from([",", ", ", " ", "\t", ";", " , "]),
)
def test_a_box_survives_any_separator(box, separator):
    assert parse_box(separator.join(repr(value) for value in box) + "\r") == box


@given(st.lists(st.sampled_from(["0", "1", "-2.5", "1e3", "nan", "inf", "x", ""]), max_size=6))
def test_only_four_numbers_make_a_box(parts):
    numbers = [float(part) for part in parts if part in ("0", "1", "-2.5", "1e3", "nan", "inf")]
    is_line = len(parts) == len(numbers) == 4
    if is_line and "nan" in parts:
        assert np.isnan(parse_box(",".join(parts))).all()
    elif is_line and "inf" not in parts and "-2.5" not in parts[2:]:
        is_absent = "0" in parts[2:]
        expected = [np.nan] * 4 if is_absent else numbers
        np.testing.assert_array_equal(parse_box(",".join(parts)), expected)
    else:
        with pytest.raises(FootageError, match="expected x,y,width,height"):
            parse_box(",".join(parts))


@pytest.mark.parametrize("line", ["nan,nan,nan,nan", "NaN\tNaN\tNaN\tNaN", "0,0,0,0", "1 2 3 0.0"])
def test_an_absent_target_is_a_row_of_nan(image_sequence, line):
    (image_sequence / "groundtruth.txt").write_text(f"1,2,3,4\n{line}\n3\t4\t3\t4\n")
    footage = read_sequence(image_sequence)
    np.testing.assert_array_equal(footage.ground_truth, [[1, 2, 3, 4], [np.nan] * 4, [3, 4, 3, 4]])
    assert len(list(footage.frames())) == 3


def test_images_and_boxes_are_joined_and_otb_s_file_name_comes_second(image_sequence, pictures):
    footage = open_footage(image_sequence)
    assert (footage.name, footage.frame_count) == ("a walk", 3)
    assert footage.ground_truth.tolist() == [[1, 2, 3, 4], [2.5, 3.5, 3, 4], [3, 4, 3, 4]]
    for frame, picture in zip(footage.frames(), pictures, strict=False):
        np.testing.assert_array_equal(frame.image, picture)
    (image_sequence / "groundtruth.txt").rename(image_sequence / "groundtruth_rect.txt")
    assert open_footage(image_sequence).ground_truth[1].tolist() == [2.5, 3.5, 3, 4]
    (image_sequence / "groundtruth.txt").write_text("5,6,7,8\n" * 3)
    assert read_sequence(image_sequence).ground_truth[1].tolist() == [5, 6, 7, 8]


@pytest.mark.parametrize("line", ["", "1,2,3,-4"])
def test_a_wrong_line_is_named_with_its_number(image_sequence, line):
    (image_sequence / "groundtruth.txt").write_text(f"1,2,3,4\n{line}\n1,2,3,4\n")
    with pytest.raises(FootageError, match=r"groundtruth\.txt, line 2: .*expected x,y,width"):
        read_sequence(image_sequence)
    (image_sequence / "groundtruth.txt").write_text("1,2,3,4\n")
    with pytest.raises(FootageError, match="3 frames but 1 box in"):
        read_sequence(image_sequence)


def test_a_shared_video_is_read_from_the_first_frame_on(tmp_path, pictures, write_video):
    (tmp_path / "video").mkdir()
    write_video(tmp_path / "video" / "all.avi", pictures, rate=10.0)
    folder = tmp_path / "part"
    folder.mkdir()
    (folder / "groundtruth.txt").write_text(BOXES)
    (folder / "meta.json").write_text(json.dumps({"video": "../video/all.avi", "first_frame": 1}))
    footage = read_sequence(folder)
    frames = list(footage.frames())
    assert footage.name == "part"
    assert [frame.stamp for frame in frames] == [1_000_000_000, 1_100_000_000, 1_200_000_000]
    for frame, picture in zip(frames, pictures[1:4], strict=True):
        np.testing.assert_array_equal(frame.image, picture)


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ("{", "cannot be read as JSON"),
        ("[]", "expected a JSON object"),
        ('{"a":' * 3000, "cannot be read as JSON: maximum recursion depth"),
        ('{"video": "../gone.avi"}', "there is no video"),
        ('{"video": 3}', "'video' is 3"),
        ('{"video": "x.avi", "first_frame": -1}', "'first_frame' is -1"),
    ],
)
def test_wrong_meta_data_is_refused(image_sequence, meta, message):
    (image_sequence / "meta.json").write_text(meta)
    with pytest.raises(FootageError, match=message):
        read_sequence(image_sequence)


def test_missing_parts_are_named(tmp_path, image_sequence):
    with pytest.raises(FootageError, match=r"nowhere is not a folder"):
        read_sequence(tmp_path / "nowhere")
    for image in (image_sequence / "img").iterdir():
        image.unlink()
    with pytest.raises(FootageError, match=r"img has no images"):
        read_sequence(image_sequence)
    (image_sequence / "img").rmdir()
    with pytest.raises(FootageError, match=r"has no frames; expected a folder img/"):
        read_sequence(image_sequence)
    (image_sequence / "groundtruth.txt").write_text("")
    with pytest.raises(FootageError, match=r"groundtruth\.txt is empty"):
        read_sequence(image_sequence)
    (image_sequence / "groundtruth.txt").unlink()
    with pytest.raises(FootageError, match=r"groundtruth\.txt cannot be read"):
        read_sequence(image_sequence)


def test_real_sequences_begin_with_a_frame_of_their_size(sequences_directory):
    folders = sorted(path.parent for path in sequences_directory.glob("*/groundtruth.txt"))
    assert folders
    for folder in folders:
        footage = read_sequence(folder)
        meta = json.loads((folder / "meta.json").read_text())
        assert footage.frame_count == len(footage.ground_truth) == meta["frames"]
        first = next(footage.frames()).image
        assert first.shape[:2] == (meta["height"], meta["width"]), folder
