"""Several targets and detections in archives with the command `track`."""

import json

import numpy as np
import pytest
from archives import options_of
from common import QUICK, one_sentence, read_boxes

from pf_tracker_ros.recordings.archives.results import results_at
from pf_tracker_ros.recordings.archives.tasks import make_tasks, required_memory
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS

COUNT = 16


@pytest.fixture
def detected_archive(walkers, write_sequence, write_detections, tmp_path):
    """Two folders of images with detections beside them, one without, and other files."""
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


def test_an_archive_of_several_targets_counts_frames(track, walkers, write_sequence, tmp_path):
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
    assert {row["id"] for row in read_boxes(output / "pair")} == {"1", "2"}
    assert {row["id"] for row in read_boxes(output / "one")} == {"1"}


def test_detections_require_more_memory(write_sequence, walkers, tmp_path):
    images, boxes = walkers
    source = write_sequence("pair", images, np.array(boxes)[:, 0])

    def needed(text, *arguments):
        source.with_name("pair.target.yaml").write_text(text)
        tasks = make_tasks({"pair": source}, results_at(tmp_path / "out"), options_of(*arguments))
        return required_memory(tasks[0])

    one = "{target_box: [1, 2, 30, 40], image_size: [240, 160]}"
    alone = needed(one)
    assert needed(f"targets: [{one}, {one}]") == alone
    assert needed(one, "--detector=motion") > 1.2 * alone


def test_an_archive_is_labeled_from_the_detections_beside_its_recordings(
    track, detected_archive, library, tmp_path
):
    output = detected_archive / "boxes"
    given = ("--archive", detected_archive, "--output", output, "--preset", "li2007")
    given = (*given, "--detections")
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    lines = said.splitlines()
    none = f"no detections for {detected_archive / 'none'}; write none.detections.csv beside it"
    # Without the advice to give a file, which applies to a single recording.
    assert [line for line in lines if "would fail" in line] == [f"would fail: {none}"]
    assert lines[-1].startswith("3 of 3 recordings, 32 frames; about ")
    code, said, errors = track(*given)
    assert code == 1
    assert one_sentence(errors).endswith(none)
    assert "3 recordings: 2 tracked, 0 up to date, 1 failed" in said
    manifest = json.loads((output / "archive.json").read_text())
    assert {entry["name"]: entry["exit_code"] for entry in manifest} == {
        "day_0/pair": 0,
        "day_1/late": 0,
        "none": WRONG_DETECTIONS,
    }
    assert {row["id"] for row in read_boxes(output / "day_0/pair")} == {"", "1", "2"}
    for name, numbers in (("day_0/pair", (3, 7, 11)), ("day_1/late", (5, 9))):
        arrivals = {number: [(library.detections(number), number)] for number in numbers}
        assert library.target_rows(read_boxes(output / name)) == library.track((), arrivals)
        # The same as for the single recording, with the default or a given file.
        for number, file in enumerate(([], [detected_archive / f"{name}.detections.csv"])):
            alone = tmp_path / f"{numbers[0]}_{number}"
            source = detected_archive / name
            single = (source, "--output", alone, "--preset", "li2007", "--detections")
            assert track(*single, *file)[0] == 0
            found = (output / name / "boxes.csv").read_bytes()
            assert found == (alone / "boxes.csv").read_bytes()


def test_only_changed_detections_are_tracked_again(track, detected_archive, tmp_path):
    output = tmp_path / "out"
    given = ("--archive", detected_archive, "--output", output, "--detections", *QUICK)
    assert "2 tracked, 0 up to date, 1 failed" in track(*given)[1]
    before = {path: path.stat().st_mtime_ns for path in output.rglob("boxes.csv")}
    assert "0 tracked, 2 up to date, 1 failed" in track(*given)[1]
    file = detected_archive / "day_1" / "late.detections.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    file.with_name("none.detections.csv").write_text("1\n")
    assert "1 tracked, 1 up to date, 1 failed" in track(*given)[1]
    changed = {path for path, at in before.items() if path.stat().st_mtime_ns != at}
    assert changed == {output / "day_1" / "late" / "boxes.csv"}
    # Without --detections they are not an input.
    (tmp_path / "list.txt").write_text("archive/day_1/late\n")
    box = detected_archive / "day_1" / "late.target.yaml"
    box.write_text("target_box: [30, 20, 24, 40]")
    given = ("--archive", tmp_path / "list.txt", "--output", tmp_path / "plain", *QUICK)
    assert "1 tracked" in track(*given)[1]
    file.write_text("1\n")
    assert "1 up to date" in track(*given)[1]


def test_an_archive_of_bags_has_detections(track, write_walkers, detections_message, library):
    bag = write_walkers([])
    archive = bag.with_name("archive")
    archive.mkdir()
    bag.rename(archive / "without_topic")
    messages = [(library.at(4) + 1000, detections_message(library.at(4), library.boxes[4]))]
    write_walkers(messages).rename(archive / "with_topic")
    # These have targets, but no topics.
    (archive / "clip.mp4").write_bytes(b"no bag")
    (archive / "clip.target.yaml").write_text("target_box: [1, 2, 30, 40]")
    (archive / "sequence").mkdir()
    (archive / "sequence" / "groundtruth.txt").write_text("1,2,30,40\n")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detections-topic", "/found", "--bag")
    given = (*given, "--preset", "li2007")
    code, said, errors = track(*given)
    assert code == 1
    assert "2 recordings: 1 tracked, 0 up to date, 1 failed" in said
    last = said.splitlines()[-1]
    assert last == "excluded: 2 recordings, such as clip.mp4; only bags have topics"
    assert "without_topic has no topic /found of type" in one_sentence(errors)
    arrivals = {4: [(library.detections(4), 4)]}
    assert library.target_rows(read_boxes(output / "with_topic")) == library.track((), arrivals)
    # The bag of the results is not a recording.
    assert "0 tracked, 1 up to date, 1 failed" in track(*given)[1]


def test_a_detector_runs_on_every_recording_of_a_folder(track, walkers, source, write_video):
    archive = source.parents[1] / "archive"
    (archive / "empty").mkdir(parents=True)
    source.rename(archive / "images")
    write_video(archive / "clip.avi", walkers[0], codec="MJPG")
    (archive / "clip.txt").write_text("about the clip")
    output = archive / "boxes"
    given = ("--archive", archive, "--output", output, "--detector", "motion", "--video", *QUICK)
    code, said, errors = track(*given, "--detector-rate", "25")
    assert (code, "2 recordings: 2 tracked" in said) == (0, True)
    manifest = json.loads((output / "archive.json").read_text())
    assert [entry["name"] for entry in manifest] == ["clip.avi", "images"]
    assert {row["frame"] for row in read_boxes(output / "images")} == {str(n) for n in range(COUNT)}
    assert "track: images: the detector 'motion' found nothing in 16 frames" in errors
    idle = errors.splitlines()[-1]
    assert idle.startswith("track: 2 of 2 recordings had no target in any frame, such as ")
    # The videos of the results are not recordings.
    assert "2 recordings: 0 tracked, 2 up to date" in track(*given, "--detector-rate", "25")[1]
    # Another rate of the detector changes the key.
    assert "2 recordings: 2 tracked" in track(*given, "--detector-rate", "5")[1]


def test_recordings_without_a_target_are_reported(track, detected_archive, tmp_path):
    (detected_archive / "none.target.yaml").write_text("target_box: [30, 20, 24, 40]")
    given = ("--archive", detected_archive, "--output", tmp_path / "out", *QUICK)
    code, said, _ = track(*given, "--dry-run")
    assert code == 0
    excluded = said.splitlines()[-1]
    assert excluded.startswith("excluded: 2 recordings without a target, such as day_0/pair; ")
    assert "excluded" not in track(*given, "--dry-run", "--detector", "motion")[1]
    code, said, _ = track(*given)
    assert (code, said.splitlines()[-1]) == (0, excluded)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--detections"], "folders of images, from the file beside each, such as drive.det"),
        (["--detections-topic", "/found"], "; detections are applied to bags"),
        (["--detector", "people"], "; detections are applied to bags, videos and folders"),
    ],
)
def test_an_archive_without_recordings_for_a_detector_says_what_it_takes(
    refusal, tmp_path, option, said
):
    (tmp_path / "notes.txt").write_text("no recording")
    assert said in refusal("--archive", tmp_path, *option)


def test_results_do_not_replace_the_detections_of_a_recording(track, detected_archive, tmp_path):
    (tmp_path / "list.txt").write_text("archive/day_0/pair\n/nowhere/pair.detections.csv\n")
    given = ("--archive", tmp_path / "list.txt", "--output", detected_archive / "day_0")
    code, _, errors = track(*given, "--detections")
    assert (code, " overlaps the input " in one_sentence(errors)) == (2, True)
