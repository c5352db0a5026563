"""Results of an archive never take the place of anything but results."""

import json
import shutil

import pytest

from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives import results as results_module
from pf_tracker_ros.recordings.archives.results import ResultsFolder, ResultsStore
from pf_tracker_ros.recordings.archives.sources import find_recordings

QUICK = ("--preset", "li2007", "--parameter", "particles=20")
TARGET = "target_box: [20, 60, 24, 40]"
DONE = json.dumps({"name": "a.avi", "source": "/rec/a.avi", "key": "0"})


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
        assert line.startswith("track: error: the results of ")
        assert line.endswith("; give an output apart from the recordings")
        assert content(tmp_path) == before

    return run


def content(folder):
    """Path to bytes of all files below a folder, and None of what is no file."""
    return {
        path: path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))
    }


@pytest.mark.parametrize("further", [(), ("--dry-run",)])
def test_the_archive_is_no_output(rec, refused, further):
    refused(rec, rec, *further)
    refused(rec.parent / "rec" / ".." / "rec", rec, *further)


def test_a_link_to_the_archive_is_no_output(rec, refused, tmp_path):
    (tmp_path / "link").symlink_to(rec)
    refused(rec, tmp_path / "link")
    refused(tmp_path / "link", rec)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.avi").symlink_to(rec / "a.avi")
    refused(rec, tmp_path / "out")


def test_results_neither_replace_sequences_nor_lie_inside(
    write_sequence, moving_square, refused, tmp_path
):
    folder = tmp_path / "walk"
    walk = write_sequence("walk", moving_square.images[:2], moving_square.boxes[:2], folder)
    refused(folder, folder)
    refused(walk, walk / "out")
    # That of the sequence would be the folder of the archive.
    refused(folder, tmp_path)


def test_results_do_not_take_the_place_of_a_link_to_a_recording_or_of_a_target(
    rec, refused, tmp_path
):
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


def test_results_do_not_take_the_place_of_the_list(rec, refused, tmp_path):
    listed = tmp_path / "out" / "a.avi" / "some.txt"
    listed.parent.mkdir(parents=True)
    listed.write_text("../../rec/a.avi\n")
    refused(listed, tmp_path / "out")


def test_results_may_go_below_the_archive(write_sequence, moving_square, track, tmp_path):
    folder = tmp_path / "fleet"
    write_sequence("walk", moving_square.images[:3], moving_square.boxes[:3], folder)
    for said_first in ("1 tracked, 0 done", "0 tracked, 1 done"):
        code, said, _ = track("--archive", folder, "--output", folder / "out", *QUICK)
        assert code == 0
        assert said_first in said
    assert (folder / "out" / "walk" / "boxes.csv").is_file()


def test_entries_that_lead_out_of_the_folder_of_a_list_keep_their_results_in_the_output(
    write_sequence, moving_square, track, tmp_path
):
    walk = write_sequence(
        "walk", moving_square.images[:3], moving_square.boxes[:3], tmp_path / "rec"
    )
    before = content(walk)
    listed = tmp_path / "lists" / "some.txt"
    listed.parent.mkdir()
    listed.write_text("../rec/walk\n")
    assert find_recordings(listed) == {"walk": walk}
    output = tmp_path / "out"
    assert track("--archive", listed, "--output", output, *QUICK)[0] == 0
    assert (output / "walk" / "done.json").is_file()
    assert content(walk) == before


def test_names_have_no_dots_that_lead_elsewhere(rec, tmp_path):
    listed = tmp_path / "some.txt"
    listed.write_text("rec/../rec/a.avi\n")
    assert find_recordings(listed) == {"rec/a.avi": rec / "a.avi"}
    listed.write_text(f"../a.avi\n{tmp_path}/../a.avi\n")
    with pytest.raises(RecordingError, match=r"would both be written as a\.avi"):
        find_recordings(listed)
    listed.write_text("/\n")
    with pytest.raises(RecordingError, match="/ has no name that its results could go by"):
        find_recordings(listed)
    # What is above a link is not what its path looks like.
    (tmp_path / "other" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "other" / "deep")
    listed.write_text("link/../b.avi\n")
    assert find_recordings(listed) == {"other/b.avi": tmp_path / "other" / "b.avi"}


def test_a_list_may_name_files_by_url(rec, refused, tmp_path):
    listed = tmp_path / "some.txt"
    listed.write_text(f"{(rec / 'a.avi').as_uri()}\n")
    assert find_recordings(listed) == {"rec/a.avi": rec / "a.avi"}
    refused(listed, tmp_path)


def test_a_list_may_begin_with_a_byte_order_mark_and_have_number_signs_in_paths(tmp_path):
    listed = tmp_path / "some.txt"
    listed.write_text(
        "\ufeffa.avi\ncam#1/d.mp4\n# a remark\n  # another\nb.avi # a third\nc.avi\t#\n", "utf-8"
    )
    assert list(find_recordings(listed)) == ["a.avi", "cam#1/d.mp4", "b.avi", "c.avi"]


@pytest.fixture
def folder_with(tmp_path):
    """Begins a run in a folder in which something has the name of a recording."""

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


def put(results, beforehand=False):
    """Put boxes there, or only begin to."""
    with results.locked() as place, place.workplace("a.avi") as workplace:
        assert not beforehand
        made = workplace / "results"
        made.mkdir()
        for name, text in (("boxes.csv", "boxes"), ("done.json", DONE)):
            (made / name).write_text(text)
        place.put(made, "a.avi")


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
def test_a_folder_of_something_else_is_left_as_it_is(folder_with, write):
    results = folder_with(write)
    before = content(results.path)
    with pytest.raises(RecordingError, match="is not of a recording's results") as told:
        put(results, beforehand=True)
    assert told.value.exit_code == 4
    with results.locked() as place:
        shutil.rmtree(results.path / "a.avi", ignore_errors=True)
        (results.path / "a.avi").unlink(missing_ok=True)
        with place.workplace("a.avi") as workplace:
            # It comes there while the recording is tracked.
            write(results.path / "a.avi")
            (workplace / "results").mkdir()
            with pytest.raises(RecordingError, match="is not of a recording's results"):
                place.put(workplace / "results", "a.avi")
    (results.path / ".lock").unlink()
    assert content(results.path) == before


@pytest.mark.parametrize("write", [lambda place: place.mkdir(), lambda p: write_notes(p, DONE)])
def test_a_folder_of_results_and_an_empty_one_are_replaced(folder_with, write):
    results = folder_with(write)
    put(results)
    assert {path.name for path in (results.path / "a.avi").iterdir()} == {"boxes.csv", "done.json"}


def test_a_recording_whose_place_is_taken_is_told_and_does_not_stop_the_others(
    write_sequence, moving_square, track, tmp_path
):
    for name in ("one", "two"):
        write_sequence(name, moving_square.images[:3], moving_square.boxes[:3], tmp_path / "rec")
    output = tmp_path / "out"
    output.mkdir()
    write_notes(output / "one")
    code, said, errors = track("--archive", tmp_path / "rec", "--output", output, *QUICK)
    assert code == 1
    assert f"track: error: {output / 'one'} exists already, is not of a recording's res" in errors
    assert "1 tracked, 0 done before, 1 failed" in said
    assert [path.name for path in (output / "one").iterdir()] == ["notes.txt"]


@pytest.fixture
def memory(monkeypatch):
    """A store in memory with a recording at memory://fleet/a.avi, that takes results."""
    fsspec = pytest.importorskip("fsspec")
    monkeypatch.setattr(results_module, "_OBJECT_STORES", ("memory",))
    store = fsspec.filesystem("memory")
    store.store.clear()
    store.pseudo_dirs[:] = [""]
    store.pipe_file("/fleet/a.avi", b"video")
    store.pipe_file("/fleet/a.target.yaml", TARGET.encode())
    yield store
    store.store.clear()


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
def test_the_url_of_the_recordings_is_no_output(memory, refused, archive, output):
    memory.pipe_file("/lists/some.txt", b"../fleet/a.avi")
    memory.pipe_file("/lists/chained.txt", b"simplecache::memory://fleet/a.avi")
    before = {name: memory.cat_file(name) for name in memory.find("/")}
    refused(archive, output)
    assert {name: memory.cat_file(name) for name in memory.find("/")} == before


def test_a_list_in_a_store_is_read_as_one_in_a_folder(memory):
    memory.pipe_file(
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
    memory.pipe_file("/lists/some.txt", b"../fleet/a.avi\na.avi")
    with pytest.raises(RecordingError, match=r"would both be written as a\.avi"):
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
def test_objects_of_something_else_are_left_as_they_are(memory, objects, tmp_path):
    results = ResultsStore("memory://boxes")
    for name, text in objects.items():
        memory.pipe_file(f"/boxes/{name}", text)
    for attempt in (lambda: put(results, True), lambda: results.put(tmp_path, "a.avi")):
        with pytest.raises(RecordingError, match="is not of a recording's results") as told:
            attempt()
        assert told.value.exit_code == 4
    found = {name: memory.cat_file(name) for name in memory.find("/boxes")}
    found.pop("/boxes/.lock")
    assert found == {f"/boxes/{name}": text for name, text in objects.items()}


def test_objects_of_results_are_replaced_also_where_they_are_unfinished(memory, monkeypatch):
    results = ResultsStore("memory://boxes")
    memory.pipe_file("/boxes/a.avi/done.json", DONE.encode())
    memory.pipe_file("/boxes/a.avi/report.html", b"page")
    whole = ["/boxes/a.avi/boxes.csv", "/boxes/a.avi/done.json"]
    put_file = type(memory).put_file

    def fail_late(self, local, remote, **further):
        if remote.endswith("done.json"):
            raise ConnectionError("the line is dead")
        put_file(self, local, remote, **further)

    for _ in range(2):
        with monkeypatch.context() as patch:
            patch.setattr(type(memory), "put_file", fail_late)
            for _ in range(2):
                with pytest.raises(RecordingError, match="the line is dead"):
                    put(results)
                assert "/boxes/a.avi/done.json" not in memory.store
        put(results)
        assert memory.find("/boxes/a.avi") == whole
        memory.rm("/boxes/a.avi", recursive=True)
