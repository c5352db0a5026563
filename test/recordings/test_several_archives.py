"""Several targets and detections in archives with the command `track`."""

import csv
import json

import cv2
import numpy as np
import pytest

from pf_tracker_ros.recordings.archives.memory import required_memory
from pf_tracker_ros.recordings.archives.results import results_at
from pf_tracker_ros.recordings.archives.tasks import make_tasks
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS

QUICK = ("--preset", "li2007", "--parameter", "particles=20")
COUNT = 16


def one_sentence(errors):
    (line,) = errors.splitlines()
    assert line.startswith("track: error: ")
    return line


@pytest.fixture
def detected_archive(walkers, write_sequence, write_detections, tmp_path):
    """Two folders of images with detections beside them, one without, and what is no recording."""
    images, boxes = walkers
    archive = tmp_path / "archive"
    for name, numbers in (("day_0/pair", (3, 7, 11)), ("day_1/late", (5, 9)), ("none", ())):
        folder = write_sequence(name.replace("/", "_"), images, np.array(boxes)[:, 0]) / "img"
        (archive / name).parent.mkdir(parents=True, exist_ok=True)
        folder.rename(archive / name)
        if numbers:
            write_detections(numbers, label=",walker").rename(archive / f"{name}.detections.csv")
    (archive / "logo.png").write_bytes(b"no image")
    (archive / "notes.txt").write_text("no recording")
    return archive


def test_an_archive_takes_targets_of_several_and_counts_frames(
    track, rows, walkers, write_sequence, tmp_path
):
    images, boxes = walkers
    archive = tmp_path / "archive"
    source = write_sequence("pair", images, np.array(boxes)[:, 0], archive)
    entries = "".join(f"\n  - target_box: {list(box)}" for box in boxes[0])
    source.with_name("pair.target.yaml").write_text(f"targets:{entries}\nimage_size: [240, 160]\n")
    write_sequence("one", images, np.array(boxes)[:, 0], archive)
    output = tmp_path / "out"
    given = ("--archive", archive, "--output", output, *QUICK)
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    assert "2 of 2 recordings, 32 frames" in said
    assert track(*given)[0] == 0
    entries = {entry["name"]: entry for entry in json.loads((output / "archive.json").read_text())}
    assert entries["pair"]["frames"] == sum(entries["pair"]["states"].values()) == COUNT
    assert {row["id"] for row in rows(output / "pair")} == {"1", "2"}
    assert {row["id"] for row in rows(output / "one")} == {"1"}
    code, _, errors = track(*given, "--detections", "d.csv")
    assert code == 2
    assert "detections is for one recording; allowed here: --detections alone" in errors


def test_with_detections_there_is_more_memory(write_sequence, walkers, tmp_path):
    images, boxes = walkers
    source = write_sequence("pair", images, np.array(boxes)[:, 0])
    results = results_at(tmp_path / "out")

    def needed(text, *arguments):
        source.with_name("pair.target.yaml").write_text(text)
        return required_memory(make_tasks({"pair": source}, results, arguments)[0])

    one = "{target_box: [1, 2, 30, 40], image_size: [240, 160]}"
    alone = needed(one)
    assert needed(f"targets: [{one}, {one}]") == alone
    assert needed(one, "--detector=motion") > 1.2 * alone


def test_an_archive_may_have_a_detector(track, walkers, write_sequence, tmp_path):
    images, boxes = walkers
    source = write_sequence("pair", images, np.array(boxes)[:, 0])
    (tmp_path / "list.txt").write_text(f"{source.name}/img\n")
    given = ("--archive", tmp_path / "list.txt", "--output", tmp_path / "out", *QUICK)
    code, _, errors = track(*given, "--detector", "motion", "--detector-rate", "25")
    assert code == 0
    name = f"{source.name}/img"
    warning, idle = errors.splitlines()
    assert warning.startswith(f"track: {name}: the detector 'motion' found nothing in 16 frames")
    said = "track: in 1 of 1 recording there was no target in any frame, such as in "
    assert idle == said + name
    with (tmp_path / "out" / source.name / "img" / "boxes.csv").open() as file:
        assert {row["frame"] for row in csv.DictReader(file)} == {str(n) for n in range(COUNT)}
    # With another detector it is not the same work.
    code, said, _ = track(*given, "--detector", "motion", "--detector-rate", "25")
    assert "1 done before" in said
    code, said, _ = track(*given, "--detector", "motion", "--detector-rate", "5")
    assert (code, "1 tracked" in said) == (0, True)


def test_an_archive_is_labeled_from_the_detections_beside_its_recordings(
    track, rows, detected_archive, library, tmp_path
):
    output = detected_archive / "boxes"
    given = ("--archive", detected_archive, "--output", output, "--detections")
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    lines = said.splitlines()
    none = f"no detections for {detected_archive / 'none'}: write none.detections.csv beside it"
    # Without the advice to give a file, which is for one recording.
    assert [line for line in lines if "would fail" in line] == [f"would fail: {none}"]
    assert lines[-1].startswith("3 of 3 recordings, 32 frames; about ")
    code, said, errors = track(*given)
    assert code == 1
    assert one_sentence(errors).endswith(none)
    assert "3 recordings: 2 tracked, 0 done before, 1 failed" in said
    manifest = json.loads((output / "archive.json").read_text())
    assert {entry["name"]: entry["exit_code"] for entry in manifest} == {
        "day_0/pair": 0,
        "day_1/late": 0,
        "none": WRONG_DETECTIONS,
    }
    assert {row["id"] for row in rows(output / "day_0/pair")} == {"", "1", "2"}
    for name, numbers in (("day_0/pair", (3, 7, 11)), ("day_1/late", (5, 9))):
        heard = {number: [(library.said(number), number)] for number in numbers}
        assert library.as_told(rows(output / name)) == library.track((), heard)
        # The same as for that recording alone, with the file found beside it or named.
        for number, file in enumerate(([], [detected_archive / f"{name}.detections.csv"])):
            alone = tmp_path / f"{numbers[0]}_{number}"
            source = detected_archive / name
            assert track(source, "--output", alone, "--detections", *file)[0] == 0
            found = (output / name / "boxes.csv").read_bytes()
            assert found == (alone / "boxes.csv").read_bytes()


def test_only_where_the_detections_have_changed_it_is_done_again(track, detected_archive, tmp_path):
    output = tmp_path / "out"
    given = ("--archive", detected_archive, "--output", output, "--detections", *QUICK)
    assert "2 tracked, 0 done before, 1 failed" in track(*given)[1]
    before = {path: path.stat().st_mtime_ns for path in output.rglob("boxes.csv")}
    assert "0 tracked, 2 done before, 1 failed" in track(*given)[1]
    file = detected_archive / "day_1" / "late.detections.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    file.with_name("none.detections.csv").write_text("1\n")
    assert "1 tracked, 1 done before, 1 failed" in track(*given)[1]
    changed = {path for path, at in before.items() if path.stat().st_mtime_ns != at}
    assert changed == {output / "day_1" / "late" / "boxes.csv"}
    # Where they are not asked for they are no input.
    (tmp_path / "list.txt").write_text("archive/day_1/late\n")
    box = detected_archive / "day_1" / "late.target.yaml"
    box.write_text("target_box: [30, 20, 24, 40]")
    given = ("--archive", tmp_path / "list.txt", "--output", tmp_path / "plain", *QUICK)
    assert "1 tracked" in track(*given)[1]
    file.write_text("1\n")
    assert "1 done before" in track(*given)[1]


def test_an_archive_of_bags_takes_detections_of_a_topic(
    track, rows, write_walkers, detections_message, library
):
    bag = write_walkers([])
    archive = bag.with_name("archive")
    archive.mkdir()
    bag.rename(archive / "unheard")
    answers = [(library.at(4) + 1000, detections_message(library.at(4), library.boxes[4]))]
    write_walkers(answers).rename(archive / "heard")
    # They have targets, and can have no topic.
    (archive / "clip.mp4").write_bytes(b"no bag")
    (archive / "clip.target.yaml").write_text("target_box: [1, 2, 30, 40]")
    (archive / "sequence").mkdir()
    (archive / "sequence" / "groundtruth.txt").write_text("1,2,30,40\n")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detections-topic", "/found", "--bag")
    code, said, errors = track(*given)
    assert code == 1
    assert "2 recordings: 1 tracked, 0 done before, 1 failed" in said
    assert said.splitlines()[-1] == (
        "2 recordings are left out, such as clip.mp4: /found is looked for in bags"
    )
    assert "unheard has no topic /found of type" in one_sentence(errors)
    heard = {4: [(library.said(4), 4)]}
    assert library.as_told(rows(output / "heard")) == library.track((), heard)
    # The bag of the results is no recording.
    assert "0 tracked, 1 done before, 1 failed" in track(*given)[1]


def test_a_detector_is_asked_about_every_recording_of_a_folder(track, walkers, source):
    archive = source.parents[1] / "archive"
    (archive / "empty").mkdir(parents=True)
    source.rename(archive / "images")
    path = str(archive / "clip.avi")
    video = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (240, 160))
    for image in walkers[0]:
        video.write(image)
    video.release()
    (archive / "clip.txt").write_text("about the clip")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detector", "motion", "--video", *QUICK)
    code, said, _ = track(*given)
    assert (code, "2 recordings: 2 tracked" in said) == (0, True)
    manifest = json.loads((output / "archive.json").read_text())
    assert [entry["name"] for entry in manifest] == ["clip.avi", "images"]
    # The videos of the results are no recordings.
    assert "2 recordings: 0 tracked, 2 done before" in track(*given)[1]


def test_what_has_no_target_is_told_of(track, detected_archive, tmp_path):
    (detected_archive / "none.target.yaml").write_text("target_box: [30, 20, 24, 40]")
    given = ("--archive", detected_archive, "--output", tmp_path / "out", *QUICK)
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    left_out = (
        "2 recordings without a target are left out, such as day_0/pair: --detections, "
        "--detections-topic or --detector finds targets"
    )
    assert said.splitlines()[-1] == left_out
    assert "left out" not in track(*given, "--dry-run", "--detector", "motion")[1]
    code, said, _ = track(*given)
    assert (code, said.splitlines()[-1]) == (0, left_out)


def test_where_nothing_can_be_detected_it_says_in_what(track, tmp_path):
    (tmp_path / "archive").mkdir()
    (tmp_path / "archive" / "notes.txt").write_text("no recording")
    for option, said in (
        (["--detections"], "folders of images, with detections beside them, such as drive.det"),
        (["--detections-topic", "/found"], "; detections are looked for in bags"),
        (["--detector", "people"], "; detections are looked for in bags, videos and folders"),
    ):
        given = ("--archive", tmp_path / "archive", "--output", tmp_path / "out", *option)
        code, _, errors = track(*given)
        assert code == 2
        assert said in one_sentence(errors)


def test_the_detections_of_a_recording_are_no_place_for_results(track, detected_archive, tmp_path):
    (tmp_path / "list.txt").write_text("archive/day_0/pair\n/nowhere/pair.detections.csv\n")
    given = ("--archive", tmp_path / "list.txt", "--output", detected_archive / "day_0")
    code, _, errors = track(*given, "--detections")
    assert code == 2
    assert "which is, contains or lies in what belongs to" in one_sentence(errors)
