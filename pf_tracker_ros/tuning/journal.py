"""The journal of the trials: an Optuna storage in one file that survives a kill at any moment.

Each line has a hash of itself and of the lines before it, so a line that is missing or was edited
is noticed before anything depends on it.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import TrialState

from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file, lexists

# Of every journal.
_BEGINNING = b'{"op_code":'
# Key of a line's hash.
_HASH = "hash"


@contextmanager
def open_journal(path: Path) -> Iterator[JournalStorage]:
    """Open a journal, made if missing, for this process alone.

    Raises:
        EvaluationError: Another process has it open, it is no journal or damaged, or cannot be
            written.
    """
    optuna.logging.set_verbosity(logging.ERROR)
    try:
        if lexists(path):
            check_file(path, "journal")
        file = path.open("a+b")
    except FootageError as error:
        raise EvaluationError(str(error)) from error
    except OSError as error:
        raise EvaluationError(f"{path} cannot be written ({error.strerror})") from error
    with file:
        try:
            # The system releases it when the process ends, however that happens.
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise EvaluationError(
                f"another run is writing {path}; wait for it, or choose another --output"
            ) from error
        try:
            _remove_partial_line(file)
            storage = JournalStorage(_HashedFile(path, _checked_hash(file)))
        # Optuna has no specific exception for this.
        except Exception as error:
            raise EvaluationError(
                f"{path} is no journal of tune, or is damaged ({type(error).__name__}: {error}); "
                "remove it, or choose another --output"
            ) from error
        yield storage


def fail_unfinished_trials(study: optuna.Study) -> None:
    """Mark the trials of a killed run as failed."""
    for _ in study.get_trials(deepcopy=False, states=(TrialState.WAITING,)):
        study.ask()
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)


def _remove_partial_line(file: BinaryIO) -> None:
    """Cut off an incomplete last line, as after a full disk.

    Raises:
        ValueError: The file is no journal.
    """
    file.seek(0)
    text = file.read()
    if text[: len(_BEGINNING)] != _BEGINNING[: len(text)]:
        raise ValueError("another kind of file")
    if text and not text.endswith(b"\n"):
        file.truncate(text.rfind(b"\n") + 1)


def _checked_hash(file: BinaryIO) -> str:
    """The hash of the last line; empty without any.

    Raises:
        ValueError: A line is damaged, or does not follow the one before it.
    """
    file.seek(0)
    hash_of_last = ""
    for number, line in enumerate(file, 1):
        entry = json.loads(line)
        if not isinstance(entry, dict) or entry.pop(_HASH, "") != _next_hash(hash_of_last, entry):
            raise ValueError(f"line {number} was changed, or one before it is missing")
        hash_of_last = _next_hash(hash_of_last, entry)
    return hash_of_last


def _next_hash(hash_of_last: str, entry: dict[str, Any]) -> str:
    return hashlib.sha256((hash_of_last + json.dumps(entry)).encode()).hexdigest()[:16]


class _HashedFile(JournalFileBackend):
    """A file whose lines have hashes.

    Args:
        path: The file.
        hash_of_last: Hash of its last line.
    """

    def __init__(self, path: Path, hash_of_last: str) -> None:
        super().__init__(str(path), _NoLock(str(path)))
        self._hash_of_last = hash_of_last

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        hashed = []
        for entry in logs:
            self._hash_of_last = _next_hash(self._hash_of_last, entry)
            hashed.append({**entry, _HASH: self._hash_of_last})
        super().append_logs(hashed)


class _NoLock(JournalFileOpenLock):
    """No lock beside that of `open_journal`: Optuna's would outlive a killed process."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        return
