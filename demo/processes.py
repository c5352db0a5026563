"""The package's executables as processes, each with a log."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType

from failure import DemoError

_STOP_TIMEOUT = 10.0


class NodeProcess:
    """A running executable; a context manager that ends it."""

    def __init__(self, executable: str, log: Path, **parameters: object) -> None:
        """Start an executable of this environment.

        Args:
            executable: `tracker` or `replay`.
            log: Where its output goes.
            **parameters: ROS parameters.

        Raises:
            DemoError: There is no such executable.
        """
        # Not the resolved path: in a virtual environment that leads to the system's Python.
        path = Path(sys.executable).parent / executable
        if not path.exists():
            raise DemoError(f"there is no {path}; `make setup` installs it")
        command = [str(path), "--ros-args"]
        for name, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ["-p", f"{name}:={text}"]
        self.name = executable
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(_STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.poll()

    def check(self) -> None:
        """Make sure that it runs or has ended well, and has nothing to complain of.

        Raises:
            DemoError: It has failed, or its log holds an error: a node stays up after one.
        """
        if self.exit_code:
            raise self.failure(f"`{self.name}` ended with exit code {self.exit_code}")
        if "[ERROR]" in self._log.read_text(errors="replace"):
            raise self.failure(f"`{self.name}` reported an error")

    def failure(self, reason: str) -> DemoError:
        """An error with the end of this process' log."""
        return DemoError(reason, self._log.read_text(errors="replace"))
