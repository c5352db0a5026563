"""Archives: every recording is tracked once, even if processes are killed."""

import json
import os
import re
import signal
from urllib.parse import unquote_to_bytes

import cv2
import pytest
from archives import TARGET, assert_whole, boxes_in, kill_worker, wait_for_results
from common import QUICK, one_sentence
from subprocesses import wait_until

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.sources import find_recordings
from pf_tracker_ros.recordings.output_files import OutputFolder


def test_recordings_are_tracked_and_broken_ones_are_reported(serial, archive, track, tmp_path):
    output, (code, said, errors) = serial
    assert code == 1
    counts = "13 recordings: 10 tracked, 0 up to date, 3 failed"
    assert said.splitlines()[-1] == f"{counts}; results in {output}"
    lines = errors.splitlines()
    assert len(lines) == 3
    for part in ("0013.png cannot be decoded", "noise.mp4", "shots.target.yaml: target refused"):
        assert sum(part in line for line in lines) == 1
    found = boxes_in(output)
    # Of the damaged one, what was tracked is kept.
    assert set(found) == {*(f"day_{number % 2}/drive_{number}" for number in range(10)), "broken"}
    assert found["broken"].count(b"\n") == 13
    assert track(archive / "day_1" / "drive_3", "--output", tmp_path / "alone", *QUICK)[0] == 0
    assert found["day_1/drive_3"] == (tmp_path / "alone" / "boxes.csv").read_bytes()
    manifest = json.loads((output / "archive.json").read_text())
    failed = {entry["name"]: entry["exit_code"] for entry in manifest if entry["error"]}
    assert failed == {"broken": 3, "noise.mp4": 3, "shots": 7}
    states = {entry["name"]: entry["states"] for entry in manifest if entry["states"]}
    assert states.pop("broken") == {"tracking": 12}
    assert list(states.values()) == [{"tracking": 20}] * 10


def test_the_report_of_an_archive_links_to_those_of_its_recordings(
    write_sequence, moving_square, track, browse, tmp_path
):
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    folder, output, name = tmp_path / "archive", tmp_path / "out", os.fsdecode(b"\xe4")
    # OpenCV cannot write into a folder of a name that is not UTF-8.
    for written in ("one #1 <b>", "broken", "odd"):
        write_sequence(written, moving_square.images[:2], moving_square.boxes[:2], folder)
    (folder / "odd").rename(folder / name)
    (folder / "broken" / "img" / "0002.png").write_bytes(b"no picture")
    code, said, _ = track("--archive", folder, "--output", output, *QUICK, "--report")
    assert code == 1
    assert "\\udce4" in said
    page = (output / "report.html").read_text()
    links = dict(re.findall(r'<a href="([^"]*)">(one #1 &lt;b&gt;|\?)</a>', page))
    assert set(links.values()) == {"one #1 &lt;b&gt;", "?"}
    for address in links:
        report = output / os.fsdecode(unquote_to_bytes(address))
        assert report.read_text().startswith("<!doctype html>")
    assert page.index('data-sequence="broken"') < page.index('data-sequence="one #1')
    assert "0002.png cannot be decoded" in page
    assert "3, of which 1 failed" in page
    assert '<td data-figure="tracking" data-value="1.0">100.0 %</td>' in page
    shown = browse(page, "return {errors, scroll: document.documentElement.scrollWidth};", 390)
    assert shown == {"errors": [], "scroll": 390}


def test_only_changed_recordings_are_tracked_again(own_archive, track, tmp_path):
    output = tmp_path / "out"
    arguments = ("--archive", own_archive, "--output", output, *QUICK)
    track(*arguments)

    def written():
        # The damaged one is tried again each time.
        return {path: path.stat().st_mtime_ns for path in output.glob("day_?/*/boxes.csv")}

    before = written()
    _, said, _ = track(*arguments)
    assert "0 tracked, 10 up to date, 3 failed" in said
    assert written() == before
    truth = own_archive / "day_0" / "drive_2" / "groundtruth.txt"
    truth.write_text(truth.read_text().replace("20,30,24,24", "21,31,24,24"))
    _, said, _ = track(*arguments)
    assert "1 tracked, 9 up to date, 3 failed" in said
    changed = {path for path, time in written().items() if time != before[path]}
    assert changed == {output / "day_0" / "drive_2" / "boxes.csv"}
    _, said, _ = track(*arguments, "--seed", 1)
    assert "10 tracked, 0 up to date, 3 failed" in said


def test_killed_processes_cost_only_recordings_in_progress(serial, archive, start_track, tmp_path):
    output = tmp_path / "out"
    arguments = ("--archive", archive, "--output", output, "--jobs", 2, *QUICK)
    for count in (0, 2, 5):
        process = start_track(*arguments)
        wait_for_results(output, count)
        process.kill()
        process.communicate()
        assert_whole(output)
    process = start_track(*arguments)
    for count in (6, 8):
        wait_for_results(output, count)
        kill_worker(process, "spawn_main")
    process.communicate(timeout=120)
    assert process.returncode == 1
    assert boxes_in(output) == boxes_in(serial[0])
    assert not list(output.rglob(".archive_*"))


def test_ctrl_c_keeps_the_finished_recordings(archive, start_track, tmp_path):
    output = tmp_path / "out"
    process = start_track("--archive", archive, "--output", output, *QUICK)
    wait_for_results(output, 1)
    process.send_signal(signal.SIGINT)
    said, errors = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "")
    assert "track: error: interrupted; unfinished files were discarded\n" in errors
    assert_whole(output)
    done = {entry["name"] for entry in json.loads((output / "archive.json").read_text())}
    assert set(boxes_in(output)) <= done
    assert 1 <= len(done) < 13
    assert not list(output.rglob(".archive_*"))


def test_a_run_keeps_the_unfinished_files_of_another(
    track, write_sequence, moving_square, tmp_path
):
    output, archive = tmp_path / "out", tmp_path / "archive"
    write_sequence("archive/only", moving_square.images[:2], moving_square.boxes[:2])
    other = OutputFolder(output / "other", {})
    (draft,) = (output / "other").iterdir()
    code, _, errors = track("--archive", archive, "--output", output, *QUICK)
    assert (code, draft.is_dir()) == (0, True), errors
    other.discard()


def test_two_runs_do_not_write_into_one_folder(archive, start_track, track, tmp_path):
    output = tmp_path / "out"
    process = start_track("--archive", archive, "--output", output, *QUICK)
    wait_until(lambda: list(output.rglob(".archive_*")))
    # The first run must not end before the second one starts.
    process.send_signal(signal.SIGSTOP)
    code, _, errors = track("--archive", archive, "--output", output, *QUICK)
    process.send_signal(signal.SIGCONT)
    assert code == 4
    assert f"another run is writing into {output}" in errors
    process.communicate(timeout=120)
    assert process.returncode == 1


def test_a_dry_run_writes_nothing_and_estimates_the_time(archive, track, tmp_path):
    code, said, _ = track(
        *("--archive", archive, "--output", tmp_path / "out", "--dry-run", "--jobs", 2, *QUICK)
    )
    assert code == 0
    lines = said.splitlines()
    assert sum(line.startswith("would track: ") for line in lines) == 11
    assert sum(line.startswith("would fail: ") for line in lines) == 2
    assert lines[-1].startswith("13 of 13 recordings, 220 frames; about 0:00:")
    cores = "2 cores" if os.cpu_count() > 1 else "1 core"
    assert f" on {cores}, at " in lines[-1]
    assert lines[-1].endswith("; 2 cannot be tracked")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", [(), ("--dry-run",)])
def test_without_targets_an_archive_says_how_to_give_them(
    track, refusal, moving_square_sequence, tmp_path, option
):
    images, listed = moving_square_sequence / "img", tmp_path / "list.txt"
    listed.write_text(f"{images}\n")
    (tmp_path / "empty").mkdir()
    how = "--detections, --detections-topic or --detector"
    assert f"or a detector: {how}" in refusal("--archive", tmp_path / "empty", *option)
    code, said, errors = track("--archive", listed, "--output", tmp_path / "out", *option)
    advice = f"no target for {images}; write img.target.yaml beside it, or detect targets with"
    assert f"{advice} {how}" in (said if option else errors)
    assert code == (0 if option else 1)
    assert not option or "1 of 1 recording, 0 frames; 1 cannot be" in said


def test_a_list_names_recordings_beside_it(own_archive):
    listed = own_archive / "some.txt"
    listed.write_text("# the first day\nday_0/drive_0\n\nday_1/drive_1  # and one of the second\n")
    assert list(find_recordings(listed)) == ["day_0/drive_0", "day_1/drive_1"]
    (own_archive / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"such as drive\.target\.yaml for drive\.mcap"):
        find_recordings(own_archive / "empty")
    with pytest.raises(FootageError, match="there is no archive"):
        find_recordings(own_archive / "nowhere")
    listed.write_text("day_0/drive_0\nday_0/drive_0/img\n")
    with pytest.raises(RecordingError, match=r"is inside .*drive_0, which is a recording"):
        find_recordings(listed)


def test_impossible_entries_of_a_list_are_reported_with_the_other_errors(
    track, ordinary_user, public_folder, moving_square, write_sequence
):
    drive = write_sequence("drive", moving_square.images, moving_square.boxes, public_folder)
    (public_folder / "closed").mkdir(mode=0o700)
    wrong = ["n" * 300, "~nobody.of.this.name/x", "http://[::1", "closed/x"]
    listed = public_folder / "list.txt"
    listed.write_text("\n".join([*wrong, "drive"]))
    dry = ("--archive", listed, "--output", public_folder / "out", "--dry-run", *QUICK)
    # The first run imports all modules, which the ordinary user may not read.
    assert track(*dry)[0] == 0
    with ordinary_user():
        code, said, _ = track(*dry)
    assert code == 0
    lines = said.splitlines()
    for entry, line in zip(wrong, lines, strict=False):
        assert line.startswith("would fail: ")
        assert entry in line
    assert lines[4] == f"would track: {drive} ({len(moving_square.images)} frames)"


def test_a_list_and_an_output_that_are_none_are_refused(track, tmp_path):
    for text, output, expected, reason in (
        (b"drive\0\n", "out", 3, "contains null characters"),
        (b"drive\n", "http://[::1", 2, "results cannot be written to http://"),
    ):
        (tmp_path / "list.txt").write_bytes(text)
        code, _, errors = track("--archive", tmp_path / "list.txt", "--output", output)
        assert (code, reason in one_sentence(errors)) == (expected, True)


def test_a_target_file_is_for_the_recording_that_it_names(tmp_path):
    for name in ("drive.mp4", "drive.txt", "drive.avi"):
        (tmp_path / name).write_bytes(b"")
    target, box = tmp_path / "drive.target.yaml", "target_box: [1, 2, 3, 4]"
    for text, found in (
        (f"recording: drive.avi\n{box}", ["drive.avi"]),
        # One that names a recording that is not there is refused with it.
        (f"recording: ride.avi\n{box}", ["drive.avi", "drive.mp4"]),
        # Without a name, it is for the entries with the suffix of a video.
        (box, ["drive.avi", "drive.mp4"]),
    ):
        target.write_text(text)
        assert list(find_recordings(tmp_path)) == found
    for suffix, text in (("MP4", ""), ("SRT", ""), ("target.yaml", box)):
        (tmp_path / f"DJI_1.{suffix}").write_text(text)
    assert {"DJI_1.MP4"} == find_recordings(tmp_path).keys() - {"drive.avi", "drive.mp4"}


def test_damaged_and_unreadable_recordings_are_reported_and_do_not_stop_the_others(
    track, write_sequence, write_video, moving_square, make_unreadable
):
    folder = write_sequence("archive/sound", moving_square.images, moving_square.boxes).parent
    output = folder.parent / "out"
    path = write_video(folder / "cut.avi", moving_square.images, codec="MJPG")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (folder / "cut.target.yaml").write_text(TARGET)
    make_unreadable(folder / "lost+found")
    code, said, errors = track("--archive", folder, "--output", output, *QUICK)
    assert code == 1
    assert "3 recordings: 1 tracked, 0 up to date, 2 failed" in said
    lines = [line for line in errors.splitlines() if line.startswith("track: error: ")]
    assert len(lines) == 2
    damage = f"video {path} is damaged: it contains "
    assert [damage in line or "lost+found" in line for line in lines] == [True, True]
    entries = {entry["name"]: entry for entry in json.loads((output / "archive.json").read_text())}
    cut = entries["cut.avi"]
    assert cut["exit_code"] == 3
    assert damage in cut["error"]
    assert 0 < cut["frames"] < 20
    assert (output / "cut.avi" / "boxes.csv").read_bytes().count(b"\n") == 1 + cut["frames"]
    allowed = ("--allow-partial", *QUICK)
    code, said, errors = track("--archive", folder, "--output", output, *allowed)
    assert "3 recordings: 2 tracked, 0 up to date, 1 failed" in said
    assert f"track: cut.avi: {damage}" in errors


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--archive", "fleet", "drive.mp4"], "SOURCE applies to a single recording"),
        (["--archive", "fleet", "--box", "1,2,3,4"], "--box applies to a single recording"),
        (["--archive", "fleet", "--report", "there"], "--report DIR applies to a single recording"),
        (["--archive", "fleet", "--detections", "d.csv"], "--detections FILE applies to a single"),
        (["--archive", "fleet", "--keyframes"], "--keyframes applies to a single recording"),
        (["--archive", "fleet", "--draw"], "--draw applies to a single recording; leave it"),
        (["--archive", "fleet", "--jobs", "0"], "whole numbers from 1"),
        ([], "SOURCE is missing; give a recording, or --archive"),
        (["--detections", "drive.mp4"], "read as the value of --detections: put SOURCE first"),
        (["--report", "drive.mp4"], "read as the value of --report: put SOURCE first"),
        (["drive.mp4", "--ray=local"], "--ray applies to archives"),
        (["drive.mp4", "--jobs=2"], "--jobs applies to archives"),
        (["drive.mp4", "--dry-run"], "--dry-run applies to archives"),
    ],
)
def test_options_of_recordings_and_archives_are_refused_for_the_other(refusal, arguments, said):
    assert said in refusal(*arguments)


def test_circular_links_do_not_stop_the_others(track, write_sequence, moving_square, tmp_path):
    folder, output = tmp_path / "archive", tmp_path / "out"
    write_sequence("drive", moving_square.images[:3], moving_square.boxes[:3], folder)
    for name in ("loop.mp4", "round", "images.target.yaml"):
        (folder / name).symlink_to(name)
    (folder / "loop.target.yaml").write_text(TARGET)
    (folder / "images").mkdir()
    assert cv2.imwrite(str(folder / "images" / "0.png"), moving_square.images[0])
    code, said, errors = track("--archive", folder, "--output", output, *QUICK)
    assert code == 1
    unreadable, missing = sorted(errors.splitlines(), key=lambda line: "there is no" in line)
    assert "images.target.yaml cannot be read (Too many levels" in unreadable
    assert f"track: error: there is no {folder / 'loop.mp4'}; accepted are" in missing
    assert "1 tracked, 0 up to date, 2 failed" in said
    code, _, errors = track("--archive", folder / "round", "--output", output, *QUICK)
    assert code == 3
    assert errors.startswith(f"track: error: there is no archive {folder / 'round'}")
    code, _, errors = track("--archive", folder, "--output", folder / "round", *QUICK)
    assert code != 0
    one_sentence(errors)
