"""The journal of the trials: an Optuna storage in one file that survives a kill at any moment."""

from __future__ import annotations

import fcntl
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import TrialState

from pf_tracker_ros.evaluation.results import EvaluationError

# Of every journal.
_BEGINNING = b'{"op_code":'


@contextmanager
def open_journal(path: Path) -> Iterator[JournalStorage]:
    """Open a journal, made if missing, for this process alone.

    Raises:
        EvaluationError: Another process has it open, it is no journal, or cannot be written.
    """
    optuna.logging.set_verbosity(logging.ERROR)
    try:
        file = path.open("a+b")
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
            storage = JournalStorage(JournalFileBackend(str(path), _NoLock(str(path))))
        # Optuna has no specific exception for this.
        except Exception as error:
            raise EvaluationError(
                f"{path} is no journal of tune ({type(error).__name__}: {error}); remove it, or "
                "choose another --output"
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


class _NoLock(JournalFileOpenLock):
    """No lock beside that of `open_journal`: Optuna's would outlive a killed process."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        return
