"""Archives with recordings and results in an object store."""

import contextlib
import json
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time

import pytest
from archives import boxes_in
from common import QUICK, read_boxes

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.results import results_at
from pf_tracker_ros.recordings.archives.scratch import scratch_folder
from pf_tracker_ros.recordings.archives.sources import find_recordings, local_copy
from pf_tracker_ros.recordings.archives.stores import parse_path_or_url

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def fleet(archive, memory):
    """A store in memory that holds the archive at memory://fleet."""
    memory.put(f"{archive}/", "/fleet/", recursive=True)
    return memory


@pytest.fixture
def scratch(monkeypatch, tmp_path):
    """The folder where scratch folders are made."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def run(fleet, track, in_this_process):
    """Tracks into memory://boxes; the entries of the manifest by name, and what was printed."""

    def start(archive="memory://fleet", *further):
        _, said, _ = track("--archive", archive, "--output", "memory://boxes", *QUICK, *further)
        entries = json.loads(fleet.cat_file("/boxes/archive.json"))
        return {entry["name"]: entry for entry in entries}, said

    return start


def stored(store, url="/boxes"):
    """Name of a recording to the bytes of its boxes."""
    return {
        name.removeprefix(f"{url}/").rpartition("/")[0]: store.cat_file(name)
        for name in store.find(url)
        if name.endswith("boxes.csv")
    }


def test_the_results_in_a_store_equal_those_in_folders(serial, archive, run, scratch):
    fleet = fsspec.filesystem("memory")
    entries, _ = run()
    assert stored(fleet) == boxes_in(serial[0])
    local = (serial[0] / "archive.json").read_text().replace(str(archive), "memory://fleet")
    assert list(entries) == [entry["name"] for entry in json.loads(local)]
    for entry in json.loads(local):
        for key in ("exit_code", "frames", "states", "error"):
            assert entries[entry["name"]][key] == entry[key]
    assert list(scratch.iterdir()) == []


def test_detections_in_a_store_are_found_beside_recordings(fleet, own_archive, run, track):
    pytest.importorskip("scipy")
    for name in ("drive_0.detections.csv", "drive_2.detections.csv"):
        text = "4,-1,33,37,24,24,0.9,square\n"
        fleet.pipe_file(f"/fleet/day_0/{name}", text.encode())
        (own_archive / "day_0" / name).write_text(text)
    output = own_archive.with_name("local")
    given = ("--archive", own_archive / "day_0", "--output", output)
    assert track(*given, *QUICK, "--detections")[0] == 1
    entries, _ = run("memory://fleet/day_0", "--detections")
    found = stored(fleet)
    assert found == boxes_in(output)
    assert set(found) == {"drive_0", "drive_2"}
    assert "no detections for memory://fleet/day_0/drive_4; " in entries["drive_4"]["error"]
    fleet.pipe_file("/fleet/day_0/drive_2.detections.csv", b"2,-1,25,33,24,24,0.9,square\n")
    _, said = run("memory://fleet/day_0", "--detections")
    assert "5 recordings: 1 tracked, 1 up to date, 3 failed" in said
    assert stored(fleet)["drive_2"] != found["drive_2"]


def test_errors_of_a_recording_in_a_store_name_its_url(fleet, run, track, scratch, tmp_path):
    fleet.pipe_file("/fleet/clip.mp4", b"no video")
    fleet.pipe_file("/fleet/clip.target.yaml", b"target_box: [1, 2, 3]")
    source, output = "memory://fleet/clip.mp4", tmp_path / "out"
    _, said, _ = track("--archive", "memory://fleet", "--output", output, *QUICK, "--dry-run")
    broken = [line for line in said.splitlines() if line.startswith("would fail: ")]
    _, _, errors = track(source, "--output", output, *QUICK)
    fleet.rm("/fleet/clip.target.yaml")
    _, _, without = track("memory://fleet/shots", "--output", output, *QUICK, "--detections")
    # An error after some tracked frames.
    code, _, late = track("memory://fleet/broken", "--output", output, *QUICK)
    assert code == 3
    entries, _ = run()
    messages = [*broken, errors, without, late, *(entry["error"] for entry in entries.values())]
    assert sum("memory://fleet/" in text for text in messages) >= 8
    assert not any(str(scratch) in text for text in messages)
    assert "memory://fleet/broken/img/0013.png cannot be decoded" in late
    assert "no detections for memory://fleet/shots; write shots.detections.csv" in without


def test_the_files_of_a_run_with_more_outputs_are_removed(fleet, run):
    fleet.pipe_file("/fleet/some.txt", b"day_0/drive_0\nmemory://fleet/day_1/drive_1  # by URL\n")
    pytest.importorskip("matplotlib")
    entries, said = run("memory://fleet/some.txt", "--report")
    assert entries.keys() == {"day_0/drive_0", "day_1/drive_1"}
    assert "2 recordings: 2 tracked" in said
    page = fleet.cat_file("/boxes/day_1/drive_1/report.html").decode()
    assert "memory://fleet/day_1/drive_1" in page
    assert tempfile.gettempdir() + "/" not in page
    run("memory://fleet/some.txt")
    assert fleet.find("/boxes/day_0/drive_0") == [
        "/boxes/day_0/drive_0/boxes.csv",
        "/boxes/day_0/drive_0/done.json",
    ]


def test_an_object_whose_name_leads_elsewhere_is_not_downloaded(fleet, tmp_path):
    secret = f"/fleet/day_0/drive_0/{'../' * 20}{tmp_path.as_posix().lstrip('/')}/planted"
    fleet.store[secret] = fleet.store["/fleet/day_0/drive_0/groundtruth.txt"]
    with (
        pytest.raises(FootageError, match=r"has an object of the name .*planted'; allowed: no"),
        local_copy("memory://fleet/day_0/drive_0"),
    ):
        pass
    assert not (tmp_path / "planted").exists()


def test_a_single_recording_may_have_a_url(track, fleet, scratch, tmp_path):
    output, others = tmp_path / "out", ["pf_tracker_ros_bagfiles", "pf_tracker_ros_scratch_2024"]
    for name in others:
        (scratch / name).mkdir()
    code, said, _ = track("memory://fleet/day_0/drive_0", "--output", output, *QUICK)
    assert code == 0
    assert said.startswith("memory://fleet/day_0/drive_0: 20 frames (100% tracking), ")
    assert len(read_boxes(output)) == 20
    # Folders of others in the temporary folder stay.
    assert sorted(path.name for path in scratch.iterdir()) == others
    with pytest.raises(FootageError, match="there is no archive memory://nowhere, or it is empty"):
        find_recordings("memory://nowhere")
    code, _, errors = track("memory://fleet/nothing.mp4", "--output", tmp_path / "more")
    assert (code, errors) == (3, "track: error: there is no memory://fleet/nothing.mp4\n")
    code, _, errors = track("nostore://fleet/drive.mp4", "--output", tmp_path / "more")
    assert code == 2
    assert "nostore://fleet/drive.mp4 cannot be opened (Protocol not known: nostore)" in errors


def test_a_dry_run_downloads_only_some_recordings(track, fleet, scratch, tmp_path):
    arguments = ("--archive", "memory://fleet", "--output", tmp_path / "out", "--dry-run", *QUICK)
    code, said, _ = track(*arguments)
    assert code == 0
    last = said.splitlines()[-1]
    counts = r"13 of 13 recordings, \d+ frames and an unknown number in \d+ of them; about 0:00:"
    assert re.match(counts, last)
    assert not (tmp_path / "out").exists()
    assert list(scratch.iterdir()) == []


def test_only_stores_with_atomic_writes_take_results(track, archive, tmp_path):
    refusal = "cannot be written to sftp://; allowed: a folder, s3://, "
    with pytest.raises(RecordingError, match=refusal):
        results_at("sftp://host/boxes")
    assert results_at(parse_path_or_url("file:///data/some%20boxes")).name == "/data/some boxes"
    code, _, errors = track(archive / "day_0" / "drive_0", "--output", "s3://bucket/boxes")
    assert code == 2
    assert "--output s3://bucket/boxes is a URL; allowed for a single recording: a" in errors


def test_scratch_folders_of_killed_processes_are_removed_and_those_in_use_stay(scratch):
    code = (
        "import sys, tempfile; tempfile.tempdir = sys.argv[1]\n"
        "from pf_tracker_ros.recordings.archives.scratch import scratch_folder\n"
        "with scratch_folder() as folder:\n"
        "    (folder / 'copy').write_text('')\n"
        "    print(folder, flush=True)\n"
        "    sys.stdin.read()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, scratch],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with contextlib.closing(process.stdin):
        other = process.stdout.readline().strip()
        with scratch_folder() as mine:
            assert {str(path) for path in scratch.iterdir()} == {other, str(mine)}
        process.send_signal(signal.SIGKILL)
        process.wait()
    process.stdout.close()
    assert [str(path) for path in scratch.iterdir()] == [other]
    with scratch_folder() as mine:
        assert list(scratch.iterdir()) == [mine]
    assert list(scratch.iterdir()) == []


@pytest.fixture
def bucket(monkeypatch, archive):
    """An object store as Amazon's that holds the archive at s3://bucket/fleet."""
    pytest.importorskip("moto", reason="needs moto[server]")
    pytest.importorskip("s3fs")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "--host", "127.0.0.1", "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    try:
        deadline = time.monotonic() + 60
        while True:
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port)).close()
                break
            assert time.monotonic() < deadline
            time.sleep(0.05)
        store = fsspec.filesystem("s3", skip_instance_cache=True)
        store.mkdir("bucket")
        store.put(f"{archive}/", "bucket/fleet/", recursive=True)
        yield store
    finally:
        server.kill()
        server.wait()


def test_killed_processes_leave_only_complete_objects(serial, bucket, start_track):
    expected = boxes_in(serial[0])
    arguments = ("--archive", "s3://bucket/fleet", "--output", "s3://bucket/boxes", "--jobs", 2)
    for count in (2, 5):
        driver = start_track(*arguments, *QUICK)
        while True:
            has_ended = driver.poll() is not None
            bucket.invalidate_cache()
            names = bucket.find("bucket/boxes")
            if sum(name.endswith("done.json") for name in names) >= count:
                break
            assert not has_ended
            time.sleep(0.02)
        driver.kill()
        driver.communicate()
        bucket.invalidate_cache()
        found = stored(bucket, "bucket/boxes")
        assert found.items() <= expected.items()
        for name in bucket.find("bucket/boxes"):
            assert not name.endswith("done.json") or json.loads(bucket.cat_file(name))
    driver = start_track(*arguments, *QUICK)
    said, _ = driver.communicate(timeout=120)
    assert driver.returncode == 1
    assert re.search(r"13 recordings: \d+ tracked, \d+ up to date, 3 failed", said)
    bucket.invalidate_cache()
    assert stored(bucket, "bucket/boxes") == expected
    assert len(json.loads(bucket.cat_file("bucket/boxes/archive.json"))) == 13


def test_an_error_of_a_store_is_reported_in_one_sentence(bucket, start_track, tmp_path):
    driver = start_track("--archive", "s3://bucket/fleet", "--output", "s3://missing/boxes")
    _, errors = driver.communicate(timeout=60)
    assert driver.returncode == 1
    (line,) = errors.splitlines()
    assert line.startswith("track: error: s3://missing/boxes/.lock cannot be written (")
