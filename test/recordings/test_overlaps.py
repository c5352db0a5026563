"""The results of an archive replace earlier results only, never recordings or other files."""

import hashlib
import json
import shutil

import pytest
from archives import TARGET
from common import QUICK

from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.results_folder import ResultsFolder
from pf_tracker_ros.recordings.archives.results_store import ResultsStore
from pf_tracker_ros.recordings.archives.sources import find_recordings

DONE = json.dumps(
    {
        "name": "a.avi",
        "source": "/rec/a.avi",
        "key": "0",
        "files": {
            name: hashlib.sha256(text).hexdigest()
            for name, text in {"boxes.csv": b"boxes", "notes.txt": b"mine"}.items()
        },
    }
)


@pytest.fixture
def rec(tmp_path):
    """A folder with a video and its target; what is in the video does not matter."""
    folder = tmp_path / "rec"
    folder.mkdir()
    (folder / "a.avi").write_bytes(b"video")
    (folder / "a.target.yaml").write_text(TARGET)
    return folder


@pytest.fixture
def refused(track, tmp_path):
    """Runs the command on an archive; it must refuse in one sentence and change nothing."""

    def run(archive, output, *further):
        before = content(tmp_path)
        code, _, errors = track("--archive", archive, "--output", output, *QUICK, *further)
        assert code == 2
        (line,) = errors.splitlines()
        assert line.startswith("track: error: the output ")
        assert line.endswith("; give an output apart from the recordings")
        assert content(tmp_path) == before

    return run


def content(folder):
    """Path to bytes of all files below a folder; None for folders and other entries."""
    return {
        path: path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))
    }


@pytest.mark.parametrize("further", [(), ("--dry-run",)])
def test_the_archive_is_not_allowed_as_output(rec, refused, further):
    refused(rec, rec, *further)
    refused(rec.parent / "rec" / ".." / "rec", rec, *further)
    (rec.parent / "link").symlink_to(rec)
    refused(rec, rec.parent / "link", *further)
    refused(rec.parent / "link", rec, *further)
    (rec.parent / "out").mkdir()
    (rec.parent / "out" / "a.avi").symlink_to(rec / "a.avi")
    refused(rec, rec.parent / "out", *further)


def test_results_replace_no_sequences_nor_lie_inside(
    write_sequence, moving_square, refused, tmp_path
):
    folder = tmp_path / "walk"
    walk = write_sequence("walk", moving_square.images[:2], moving_square.boxes[:2], folder)
    refused(folder, folder)
    refused(walk, walk / "out")
    # The results of the sequence would replace the folder of the archive.
    refused(folder, tmp_path)


def test_results_do_not_replace_a_link_to_a_recording_or_a_target_file(rec, refused, tmp_path):
    links = tmp_path / "links"
    links.mkdir()
    (links / "b.avi").symlink_to(rec / "a.avi")
    listed = tmp_path / "some.txt"
    listed.write_text("links/b.avi\n")
    refused(listed, tmp_path)
    named = tmp_path / "named" / "a.target.yaml"
    named.parent.mkdir()
    named.write_bytes(b"a recording of that name")
    listed.write_text("rec/a.avi\nnamed/a.target.yaml\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "named").symlink_to(rec)
    refused(listed, tmp_path / "out")
    # Nor the list.
    listed = tmp_path / "results" / "a.avi" / "some.txt"
    listed.parent.mkdir(parents=True)
    listed.write_text("../../rec/a.avi\n")
    refused(listed, tmp_path / "results")


def test_names_do_not_contain_parent_folders(rec, tmp_path):
    listed = tmp_path / "some.txt"
    listed.write_text("rec/../rec/a.avi\n")
    assert find_recordings(listed) == {"rec/a.avi": rec / "a.avi"}
    listed.write_text("../a.avi\n")
    assert find_recordings(listed) == {"a.avi": tmp_path.parent / "a.avi"}
    listed.write_text(f"../a.avi\n{tmp_path}/../a.avi\n")
    with pytest.raises(RecordingError, match=r"would share the results folder a\.avi"):
        find_recordings(listed)
    listed.write_text("/\n")
    with pytest.raises(RecordingError, match="/ has no name for its results"):
        find_recordings(listed)
    # The parent of a link depends on where it points.
    (tmp_path / "other" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "other" / "deep")
    listed.write_text("link/../b.avi\n")
    assert find_recordings(listed) == {"other/b.avi": tmp_path / "other" / "b.avi"}


def test_a_list_may_name_files_by_url(rec, refused, tmp_path):
    listed = tmp_path / "some.txt"
    listed.write_text(f"{(rec / 'a.avi').as_uri()}\n")
    assert find_recordings(listed) == {"rec/a.avi": rec / "a.avi"}
    refused(listed, tmp_path)


@pytest.fixture
def folder_with(tmp_path):
    """Makes results in a folder where an entry has the name of a recording."""

    def make(write):
        output = tmp_path / "out"
        shutil.rmtree(output, ignore_errors=True)
        output.mkdir()
        write(output / "a.avi")
        return ResultsFolder(output)

    return make


def write_notes(place, done=None):
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    if done is not None:
        (place / "done.json").write_text(done)


def put(results, fails_before=False):
    """Put boxes into place; `fails_before` means that the staging folder is refused."""
    with results.locked() as locked, locked.staging_folder("a.avi") as staging:
        assert not fails_before
        staged = staging / "results"
        staged.mkdir()
        for name, text in (("boxes.csv", "boxes"), ("done.json", DONE)):
            (staged / name).write_text(text)
        locked.put(staged, "a.avi")


@pytest.mark.parametrize(
    "write",
    [
        lambda place: place.write_text("mine"),
        write_notes,
        lambda place: write_notes(place, "{}"),
        lambda place: write_notes(place, "no JSON"),
        lambda place: place.symlink_to("nowhere"),
    ],
)
def test_a_folder_without_results_is_not_overwritten(folder_with, write):
    results = folder_with(write)
    before = content(results.path)
    with pytest.raises(RecordingError, match="holds no results") as raised:
        put(results, fails_before=True)
    assert raised.value.exit_code == 4
    with results.locked() as locked:
        shutil.rmtree(results.path / "a.avi", ignore_errors=True)
        (results.path / "a.avi").unlink(missing_ok=True)
        with locked.staging_folder("a.avi") as staging:
            # It appears while the recording is tracked.
            write(results.path / "a.avi")
            (staging / "results").mkdir()
            with pytest.raises(RecordingError, match="holds no results"):
                locked.put(staging / "results", "a.avi")
    (results.path / ".lock").unlink()
    assert content(results.path) == before


@pytest.mark.parametrize("write", [lambda place: place.mkdir(), lambda p: write_notes(p, DONE)])
def test_a_folder_of_results_and_an_empty_one_are_replaced(folder_with, write):
    results = folder_with(write)
    put(results)
    assert {path.name for path in (results.path / "a.avi").iterdir()} == {"boxes.csv", "done.json"}


@pytest.mark.usefixtures("in_this_process")
def test_a_recording_whose_folder_exists_is_reported_and_does_not_stop_the_others(
    write_sequence, moving_square, track, tmp_path
):
    for name in ("one", "two"):
        write_sequence(name, moving_square.images[:3], moving_square.boxes[:3], tmp_path / "rec")
    output = tmp_path / "out"
    output.mkdir()
    write_notes(output / "one")
    code, said, errors = track("--archive", tmp_path / "rec", "--output", output, *QUICK)
    assert code == 1
    assert f"track: error: {output / 'one'} exists already, holds no results, and is" in errors
    assert "1 tracked, 0 up to date, 1 failed" in said
    assert [path.name for path in (output / "one").iterdir()] == ["notes.txt"]


@pytest.fixture
def store(memory):
    """A store in memory with a recording at memory://fleet/a.avi."""
    memory.pipe_file("/fleet/a.avi", b"video")
    memory.pipe_file("/fleet/a.target.yaml", TARGET.encode())
    return memory


@pytest.mark.parametrize(
    ("archive", "output"),
    [
        ("memory://fleet", "memory://fleet"),
        ("memory://fleet", "memory:///fleet/"),
        ("memory://fleet", "memory://boxes/../fleet"),
        ("memory://fleet", "memory://boxes//../fleet/"),
        ("memory://lists/some.txt", "memory://fleet"),
        ("memory://lists/chained.txt", "memory://fleet"),
    ],
)
def test_the_url_of_the_recordings_is_not_allowed_as_output(store, refused, archive, output):
    store.pipe_file("/lists/some.txt", b"../fleet/a.avi")
    store.pipe_file("/lists/chained.txt", b"simplecache::memory://fleet/a.avi")
    before = {name: store.cat_file(name) for name in store.find("/")}
    refused(archive, output)
    assert {name: store.cat_file(name) for name in store.find("/")} == before


def test_a_list_in_a_store_is_read_as_one_in_a_folder(store):
    store.pipe_file(
        "/lists/some.txt",
        "\ufeff../fleet/a.avi\ncam#1/d.mp4\nb.avi # remark\n/c.avi\nmemory://x/../y/e.avi".encode(),
    )
    assert find_recordings("memory://lists/some.txt") == {
        "a.avi": "memory://fleet/a.avi",
        "cam#1/d.mp4": "memory://lists/cam#1/d.mp4",
        "b.avi": "memory://lists/b.avi",
        "c.avi": "memory://lists//c.avi",
        "e.avi": "memory://x/../y/e.avi",
    }
    store.pipe_file("/lists/some.txt", b"../fleet/a.avi\na.avi")
    with pytest.raises(RecordingError, match=r"would share the results folder a\.avi"):
        find_recordings("memory://lists/some.txt")


@pytest.mark.parametrize(
    "objects",
    [
        {"a.avi": b"video"},
        {"a.avi/notes.txt": b"mine"},
        {"a.avi/notes.txt": b"mine", "a.avi/done.json": b"{}"},
        {"a.avi/notes.txt": b"mine", "a.avi/old/done.json": DONE.encode()},
    ],
)
def test_objects_without_results_are_not_overwritten(store, objects, tmp_path):
    results = ResultsStore("memory://boxes")
    for name, text in objects.items():
        store.pipe_file(f"/boxes/{name}", text)
    for attempt in (lambda: put(results, True), lambda: results.put(tmp_path, "a.avi")):
        with pytest.raises(RecordingError, match="holds no results") as raised:
            attempt()
        assert raised.value.exit_code == 4
    found = {name: store.cat_file(name) for name in store.find("/boxes")}
    found.pop("/boxes/.lock")
    assert found == {f"/boxes/{name}": text for name, text in objects.items()}
