"""Files of results, each written anew whenever there is more to tell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pf_tracker_ros.atomic_files import atomic_write, hidden_folder
from pf_tracker_ros.evaluation.results import EvaluationError


class OutputFile:
    """A file that is written anew with each result; what was there last stays until then.

    Attributes:
        error: Why the last writing failed, in a sentence; None if it did not.

    Args:
        path: The file; whether it can be written is tried at once.

    Raises:
        EvaluationError: It cannot be written; the message says why.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.error: str | None = None
        try:
            if path.is_dir():
                raise EvaluationError(f"{path} is a folder; allowed: a file to write")
            if not path.parent.is_dir():
                raise EvaluationError(f"no folder {path.parent} to write {path.name} into")
            if path.exists() and not path.is_file():
                # To put a file in its place would do away with a device.
                raise EvaluationError(f"{path} is no regular file; allowed: a file to write")
            if path.exists():
                path.open("r+b").close()
            with hidden_folder(path.resolve().parent, ".draft_") as folder:
                (folder / path.name).write_bytes(b"\n")
        except OSError as error:
            raise EvaluationError(_failure(path, error)) from error

    def write(self, write: Callable[[Path], object]) -> str | None:
        """Write it anew.

        Args:
            write: Writes into the path that it is given, which has this file's ending.

        Returns:
            Why that failed, where the last writing did not fail for the same reason; None if all
            went well or nothing is to be said anew.
        """
        before, self.error = self.error, None
        try:
            with atomic_write(self._path) as draft:
                write(draft)
        except OSError as error:
            self.error = f"{_failure(self._path, error)}; what was written before is kept"
        return self.error if self.error != before else None


def _failure(path: Path, error: OSError) -> str:
    return f"{path} cannot be written ({error.strerror or type(error).__name__})"
