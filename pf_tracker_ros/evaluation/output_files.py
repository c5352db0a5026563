"""Result files that are rewritten after each result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pf_tracker_ros.atomic_files import atomic_write, hidden_folder
from pf_tracker_ros.evaluation.results import EvaluationError


class OutputFile:
    """A file that is replaced atomically by each write.

    Attributes:
        error: Error message of the last write, None if it succeeded.

    Args:
        path: The file. The constructor checks that it can be written.

    Raises:
        EvaluationError: It cannot be written.
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
                # Replacing a device by a file would remove the device.
                raise EvaluationError(f"{path} is no regular file; allowed: a file to write")
            if path.exists():
                path.open("r+b").close()
            with hidden_folder(path.resolve().parent, ".draft_") as folder:
                (folder / path.name).write_bytes(b"\n")
        except OSError as error:
            raise EvaluationError(_failure(path, error)) from error

    def write(self, write: Callable[[Path], object]) -> str | None:
        """Replace the file.

        Args:
            write: Writes to the path in its argument, which has the file's suffix.

        Returns:
            Error message; None on success, or if the last write had the same error.
        """
        before, self.error = self.error, None
        try:
            with atomic_write(self._path) as draft:
                write(draft)
        except OSError as error:
            self.error = f"{_failure(self._path, error)}; its last version is kept"
        return self.error if self.error != before else None


def _failure(path: Path, error: OSError) -> str:
    return f"{path} cannot be written ({error.strerror or type(error).__name__})"
