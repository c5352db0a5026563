"""The files beside the results of an archive that tell its own files from others, and errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pf_tracker_ros.recordings.archives.file_records import parse_record
from pf_tracker_ros.recordings.errors import FAILED, OUTPUT_EXISTS, RecordingError

DONE_FILE = "done.json"
LOCK = ".lock"
RECORD = ".track_files.json"
"""Hashes of the files beside the folders of the recordings, such as the manifest."""
_OWN_LOCK = re.compile(r"[0-9a-f]{16}|")


def is_own_text(name: str, found: Mapping[str, str]) -> bool:
    """Whether the lock or the record has a content that `track` writes."""
    text = found.get(name)
    if text is None:
        return False
    if name == LOCK:
        return _OWN_LOCK.fullmatch(text) is not None
    return parse_record(text) is not None


def not_own_error(path_or_url: str) -> RecordingError:
    """The error that a file beside the results is of another program."""
    return RecordingError(
        f"{path_or_url} is not a file of track, and is not overwritten; move it, or give another "
        "output",
        OUTPUT_EXISTS,
    )


def changed_error(path_or_url: Path | str) -> RecordingError:
    """The error that files have changed while a recording was tracked."""
    return RecordingError(
        f"files in {path_or_url} were changed while its recording was tracked, and nothing was "
        "replaced; run the command again",
        FAILED,
    )


def not_results_error(path_or_url: str) -> RecordingError:
    """The error that what is in the place of results is something else."""
    return RecordingError(
        f"{path_or_url} exists already, holds no results, and is not overwritten; move it, or give "
        "another output",
        OUTPUT_EXISTS,
    )
