from dataclasses import replace

import cv2
import numpy as np
import pytest

INFO = "[Sequence]\nname=drawn\nframeRate=10\nseqLength=12\nimWidth=160\nimHeight=120\n"
FIRST = 3


@pytest.fixture
def folders(tmp_path, moving_square):
    """Everybody of some footage, one of them outside of the image, and one's window of it."""
    people, window = tmp_path / "people", tmp_path / "window"
    (window / "img").mkdir(parents=True)
    people.mkdir()
    (people / "seqinfo.ini").write_text(INFO)
    truth, found = [], []
    for number, (x, y, width, height) in enumerate(moving_square.boxes[:12], start=1):
        at = f"{x + 1:g},{y + 1:g},{width:g},{height:g}"
        truth.append(f"{number},4,-60,{y + 1:g},{width:g},{height:g},1,0,0,0")
        truth.append(f"{number},7,{at},1,0,0,0")
        found.append(f"{number},-1,{at},0.9,-1,-1,-1")
    (people / "gt.txt").write_text("\n".join(truth))
    (people / "det.txt").write_text("\n".join(found))
    for number, image in enumerate(moving_square.images[FIRST:12], start=1):
        cv2.imwrite(str(window / "img" / f"{number:04d}.png"), image)
    np.savetxt(window / "groundtruth.txt", moving_square.boxes[FIRST:12], "%g", ",")
    return people, window


@pytest.fixture
def window(benchmark, folders):
    pedestrians = benchmark("pedestrians")
    people, folder = folders
    return pedestrians.find_window(
        pedestrians.read_window(folder), pedestrians.read_sequence(people, folder)
    )


def test_a_window_is_found_by_the_boxes_of_its_target(window):
    assert (window.target, window.first) == (7, FIRST)


def test_a_target_that_the_challenge_does_not_score_in_some_frames_is_found(
    benchmark, folders, tmp_path
):
    people, folder = folders
    scored = f"{FIRST + 2},7,"
    rows = (people / "gt.txt").read_text().splitlines()
    rows = [row.replace(",1,0,0,0", ",0,0,0,0") if row.startswith(scored) else row for row in rows]
    (people / "gt.txt").write_text("\n".join(rows))
    arguments = ["--window", str(people), str(folder), "--output", str(tmp_path / "results")]
    assert benchmark("pedestrians").main(arguments) == 0
    scores = benchmark("targets").read_sequence(people, folder)
    assert [7 in one.ids for one in scores.truth].count(False) == 1


def test_a_window_of_other_footage_is_refused(benchmark, folders):
    people, folder = folders
    boxes = np.loadtxt(folder / "groundtruth.txt", delimiter=",") + 5.0
    np.savetxt(folder / "groundtruth.txt", boxes, "%g", ",")
    with pytest.raises(SystemExit):
        benchmark("pedestrians").main(["--window", str(people), str(folder)])


def test_the_target_is_followed_in_every_way_beside_those_in_the_image(benchmark, window):
    pedestrians = benchmark("pedestrians")
    assert list(window.everybody.truth[FIRST].ids) == [4, 7]
    assert len(pedestrians._others(window, (120, 160, 3))) == 0
    assert len(pedestrians._others(replace(window, target=4), (120, 160, 3))) == 1
    for follow in pedestrians.WAYS.values():
        boxes = follow(window, 0)
        assert len(boxes) == len(window.truth)
        assert pedestrians.overlap(boxes, window.truth).min() > 0.6


def test_the_table_has_every_window_and_their_mean(benchmark, folders, tmp_path):
    people, folder = folders
    output = tmp_path / "results"
    arguments = ["--window", str(people), str(folder), "--output", str(output)]
    assert benchmark("pedestrians").main(arguments) == 0
    *_, row, mean = (output / "pedestrians.md").read_text().splitlines()
    assert row.split("|")[1].strip() == "window"
    assert mean.split("|")[1].strip() == "mean"
    assert row.split("|")[2:] == mean.split("|")[2:]
