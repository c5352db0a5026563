"""A run of an archive replaces and removes only what an earlier run has written."""

import hashlib
import json
import os
import shutil

import pytest
from archives import fail_late
from common import QUICK

from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.results_folder import ResultsFolder
from pf_tracker_ros.recordings.archives.results_store import ResultsStore

RECORDS = {".lock", ".track_files.json"}


@pytest.fixture
def fleet(write_sequence, moving_square, tmp_path):
    """An archive of one sequence, `drive`."""
    write_sequence("drive", moving_square.images[:3], moving_square.boxes[:3], tmp_path / "fleet")
    return tmp_path / "fleet"


@pytest.fixture
def run(fleet, track, in_this_process, tmp_path):
    """Tracks the archive into the folder `out`."""

    def run(*further):
        return track("--archive", fleet, "--output", tmp_path / "out", *QUICK, *further)

    return run


@pytest.fixture
def drive(tmp_path):
    """The folder of the results of `drive`."""
    return tmp_path / "out" / "drive"


def content(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in RECORDS
    }


def test_added_and_changed_files_stay_and_are_named(run, drive):
    assert run("--format", "cvat,mot")[0] == 0
    first = content(drive)
    (drive / "corrected.zip").write_bytes(b"an hour of work")
    (drive / "notes").mkdir()
    (drive / "notes" / "a.txt").write_text("deep")
    (drive / "link").symlink_to("../nowhere")
    (drive / "boxes.cvat.xml").write_text("by hand")
    code, said, errors = run("--format", "cvat", "--seed", 1)
    assert code == 9
    assert "1 tracked, 0 up to date, 0 failed" in said
    (line,) = errors.splitlines()
    assert line.startswith(f"track: {drive}: kept boxes.cvat.xml (added or changed since) in place")
    assert "; kept corrected.zip, link, notes (added or changed since)" in line
    found = content(drive)
    assert found["corrected.zip"] == b"an hour of work"
    assert found["notes/a.txt"] == b"deep"
    assert found["boxes.cvat.xml"] == b"by hand"
    assert str((drive / "link").readlink()) == "../nowhere"
    # What the run has written is replaced, or removed if the new options do not have it.
    assert found["boxes.csv"] != first["boxes.csv"]
    assert "boxes.mot.txt" not in found


def test_a_file_in_place_of_a_new_one_is_named_until_it_is_moved(run, drive):
    run()
    (drive / "boxes.mot.txt").write_text("mine")
    assert run("--format", "mot")[0] == 9
    code, said, errors = run("--format", "mot")
    assert (code, "0 tracked, 1 up to date" in said) == (9, True)
    assert "kept boxes.mot.txt (added or changed since) in place of the new version" in errors
    (drive / "boxes.mot.txt").rename(drive / "mine.txt")
    code, said, errors = run("--format", "mot")
    assert (code, "1 tracked, 0 up to date" in said) == (9, True)
    assert "kept mine.txt" in errors
    assert (drive / "boxes.mot.txt").read_text() != "mine"
    # Beside the results, it is nothing to repeat.
    assert run("--format", "mot")[::2] == (0, "")


def test_manifest_and_report_of_others_stay(run, drive):
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    output = drive.parent
    output.mkdir()
    for name in ("archive.json", "report.html"):
        (output / name).write_text("mine")
    code, _, errors = run("--report")
    assert code == 9
    for name in ("archive.json", "report.html"):
        assert (output / name).read_text() == "mine"
        assert f"track: {output}: kept {name} (added or changed since)" in errors
        (output / name).unlink()
    assert run("--report")[0] == 0
    assert run("--report", "--seed", 1)[0] == 0
    assert json.loads((output / "archive.json").read_text())[0]["name"] == "drive"


@pytest.mark.parametrize("name", sorted(RECORDS))
@pytest.mark.parametrize("kind", ["file", "link", "pipe"])
def test_another_program_s_lock_stays(run, drive, tmp_path, name, kind):
    output = drive.parent
    output.mkdir()
    mine = tmp_path / "mine"
    mine.write_text("process 12")
    if kind == "file":
        mine.rename(output / name)
        mine = output / name
    elif kind == "link":
        (output / name).symlink_to(mine)
    else:
        os.mkfifo(output / name)
    code, _, errors = run()
    assert code == 4
    assert f"{output / name} is not a file of track, and is not overwritten" in errors
    assert mine.read_text() == "process 12"


def test_only_staging_folders_of_a_run_are_removed(run, drive):
    run()
    for name in (".archive_2024", "drive/.archive_old"):
        (drive.parent / name).mkdir()
        (drive.parent / name / "photo.jpg").write_bytes(b"photo")
    killed = drive.parent / ".archive_0123456789abcdef_abcd_123"
    (killed / "results").mkdir(parents=True)
    run()
    found = content(drive.parent)
    assert found[".archive_2024/photo.jpg"] == found["drive/.archive_old/photo.jpg"] == b"photo"
    assert not killed.exists()


def test_results_of_a_run_that_was_killed_between_two_renames_are_put_back(run, drive):
    run()
    before = content(drive)
    # A removed result is written again.
    (drive / "boxes.csv").unlink()
    assert "1 tracked, 0 up to date" in run()[1]
    assert content(drive) == before
    (drive / "corrected.zip").write_bytes(b"an hour of work")
    before = content(drive)
    staging = drive.parent / ".archive_0123456789abcdef_abcd_123"
    (staging / "before").mkdir(parents=True)
    drive.rename(staging / "before" / "drive")
    assert run()[0] == 0
    assert content(drive) == before
    assert not staging.exists()


def put(results, staged, kept):
    staged.mkdir(exist_ok=True)
    (staged / "boxes.csv").write_text("new")
    results.put(staged, "drive", kept)


@pytest.mark.parametrize("moment", ["rename fails", "file is added"])
def test_what_fails_while_results_are_replaced_leaves_the_former(run, drive, monkeypatch, moment):
    run()
    added, kept = drive / "corrected.zip", []
    if moment == "rename fails":
        kept.append(added.name)
        added.write_bytes(b"an hour of work")
    before, rename = content(drive), type(drive).replace

    def go_wrong(path, target):
        if path.name == "results" and kept:
            raise OSError(5, "Input/output error")
        if path == drive and not kept:
            added.write_bytes(b"an hour of work")
        return rename(path, target)

    reason = "Input/output error" if kept else "were changed while its recording was tracked"
    with ResultsFolder(drive.parent).locked() as results:
        monkeypatch.setattr(type(drive), "replace", go_wrong)
        with (
            pytest.raises(RecordingError, match=reason),
            results.staging_folder("drive") as staging,
        ):
            put(results, staging / "results", kept)
    assert content(drive) == {**before, "corrected.zip": b"an hour of work"}


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000 + "]" * 100_000,
        "null",
        '{"name": 1, "source": 2, "key": 3, "files": 4}',
        '{"name": "drive", "source": "", "key": "", "files": {"boxes.csv": [[1], {}]}}',
    ],
)
def test_a_done_file_of_any_content_stops_nothing(run, drive, text):
    drive.mkdir(parents=True)
    (drive / "done.json").write_text(text)
    code, _, errors = run()
    assert code in (0, 1)
    assert "Traceback" not in errors
    assert (drive / "done.json").exists()


@pytest.mark.parametrize(
    ("name", "value"),
    [("frames", "many"), ("states", []), ("warnings", 3), ("files", {"a": 1}), ("exit_code", True),
     ("name", "other"), ("kept", {}), ("frames", 10**400), ("error", None)],
)  # fmt: skip
def test_an_entry_with_a_wrong_value_is_not_up_to_date(run, drive, name, value):
    run()
    done = json.loads((drive / "done.json").read_text())
    (drive / "done.json").write_text(json.dumps({**done, name: value}))
    code, said, errors = run()
    counts = "0 tracked, 1 up to date" if name == "name" else "1 tracked, 0 up to date"
    assert counts in said
    assert code in (0, 9), errors
    assert json.loads((drive.parent / "archive.json").read_text())[0]["name"] == "drive"


@pytest.fixture
def put_objects(memory, tmp_path):
    """Puts files of a name and text into the store as the results of `drive`."""

    def put(files, kept=()):
        staged = tmp_path / "results"
        shutil.rmtree(staged, ignore_errors=True)
        staged.mkdir()
        for name, text in files.items():
            (staged / name).write_text(text)
        hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}
        done = {"name": "drive", "source": "", "key": "", "files": hashes}
        (staged / "done.json").write_text(json.dumps(done))
        ResultsStore("memory://boxes").put(staged, "drive", kept)

    return put


def test_added_and_changed_objects_stay(memory, put_objects):
    results = ResultsStore("memory://boxes")
    put_objects({"boxes.csv": "1", "boxes.mot.txt": "1", "boxes.cvat.xml": "1"})
    memory.pipe_file("/boxes/drive/corrected.zip", b"work")
    memory.pipe_file("/boxes/drive/boxes.cvat.xml", b"by hand")
    with pytest.raises(RecordingError, match="were changed while its recording was tracked"):
        put_objects({"boxes.csv": "2"})
    kept = ["boxes.cvat.xml", "corrected.zip"]
    assert results.kept_files("drive") == kept
    put_objects({"boxes.csv": "2", "boxes.cvat.xml": "2"}, kept)
    found = {name: memory.cat_file(name) for name in memory.find("/boxes/drive")}
    del found["/boxes/drive/done.json"]
    assert found == {
        "/boxes/drive/boxes.csv": b"2",
        "/boxes/drive/boxes.cvat.xml": b"by hand",
        "/boxes/drive/corrected.zip": b"work",
    }
    assert results.complete({"drive": ["boxes.csv"], "other": ["boxes.csv"]}) == {"drive"}


def test_added_objects_stay_after_an_upload_that_failed(memory, put_objects, monkeypatch):
    put_objects({"boxes.csv": "0", "boxes.mot.txt": "0"})
    with monkeypatch.context() as patch:
        fail_late(memory, patch)
        for _ in range(2):
            with pytest.raises(RecordingError, match="the line is dead"):
                put_objects({"boxes.csv": "1"})
            assert "/boxes/drive/done.json" not in memory.store
    memory.pipe_file("/boxes/drive/corrected.zip", b"work")
    assert ResultsStore("memory://boxes").kept_files("drive") == ["corrected.zip"]
    put_objects({"boxes.csv": "2"}, ["corrected.zip"])
    found = {name.rpartition("/")[2]: memory.cat_file(name) for name in memory.find("/boxes/drive")}
    del found["done.json"]
    assert found == {"boxes.csv": b"2", "corrected.zip": b"work"}


def test_manifest_and_lock_of_others_in_a_store_stay(memory, fleet, track):
    with ResultsStore("memory://boxes").locked() as results:
        assert results.put_text("one", "archive.json")
        assert results.put_text("two", "archive.json")
        memory.pipe_file("/boxes/archive.json", b"mine")
        assert not results.put_text("three", "archive.json")
    assert memory.cat_file("/boxes/archive.json") == b"mine"
    memory.pipe_file("/boxes/.lock", b"process 12")
    code, _, errors = track("--archive", fleet, "--output", "memory://boxes", *QUICK)
    assert code == 4
    assert "memory://boxes/.lock is not a file of track" in errors
    assert memory.cat_file("/boxes/.lock") == b"process 12"
