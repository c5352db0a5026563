"""Atomic file writes."""

import errno
import os

import pytest

from pf_tracker_ros.atomic_files import atomic_write, hidden_folder


@pytest.fixture
def path(tmp_path):
    """A file that is there."""
    place = tmp_path / "result.txt"
    place.write_text("old")
    return place


def write(path, text="new", **options):
    with atomic_write(path, **options) as draft:
        draft.write_text(text)


def test_the_former_file_stays_until_the_draft_is_complete(path):
    with atomic_write(path) as draft:
        draft.write_text("new")
        assert (draft.name, path.read_text()) == ("result.txt", "old")
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def test_a_draft_that_fails_leaves_nothing(path):
    def fail():
        with atomic_write(path) as draft:
            draft.write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        fail()
    assert path.read_text() == "old"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("has_links", [True, False], ids=["links", "no links"])
def test_an_existing_file_stays_without_may_replace(tmp_path, monkeypatch, has_links):
    def refuse(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    path = tmp_path / "result.txt"
    write(path, may_replace=False)
    assert path.read_text() == "new"
    with pytest.raises(FileExistsError):
        write(path, "newer", may_replace=False)
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interruption_while_a_folder_is_removed_leaves_none(tmp_path, monkeypatch):
    remove, moments = os.rmdir, []

    def interrupted(*args, **options):
        if not moments:
            moments.append(args)
            raise KeyboardInterrupt
        remove(*args, **options)

    monkeypatch.setattr(os, "rmdir", interrupted)
    with pytest.raises(KeyboardInterrupt), hidden_folder(tmp_path, ".work_") as folder:
        (folder / "file").write_text("half")
    assert list(tmp_path.iterdir()) == []
