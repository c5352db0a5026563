"""Runs the package's executables as processes, each with a log file."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from failure import DemoError

_STOP_TIMEOUT = 10.0
_RUN_TIMEOUT = 300.0


def ros_arguments(parameters: Mapping[str, object]) -> list[str]:
    """ROS parameters as arguments of an executable."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        arguments += ["-p", f"{name}:={text}"]
    return arguments


def run_to_end(executable: str, arguments: Sequence[str], log: Path) -> None:
    """Run an executable of this environment to its end.

    Args:
        executable: Its name.
        arguments: Its arguments.
        log: File for its output.

    Raises:
        DemoError: It is not installed, failed or timed out.
    """
    run_command([str(_installed(executable)), *arguments], log)


def run_command(command: Sequence[str], log: Path) -> None:
    """Run a command to its end.

    Args:
        command: Path of the executable, and its arguments.
        log: File for its output.

    Raises:
        DemoError: It failed or timed out.
    """
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_RUN_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise DemoError(f"`{shlex.join(command)}` did not end within {_RUN_TIMEOUT:g} s") from error
    log.write_text(done.stdout + done.stderr)
    if done.returncode:
        raise DemoError(
            f"`{shlex.join(command)}` ended with exit code {done.returncode}", done.stderr
        )


def _installed(executable: str) -> Path:
    """The path of an executable of this environment.

    Raises:
        DemoError: It is not installed.
    """
    # Not the resolved path: that is the system's Python in a virtual environment.
    path = Path(sys.executable).parent / executable
    if not path.exists():
        raise DemoError(f"there is no {path}; `make setup` installs it")
    return path


class NodeProcess:
    """A running executable; as a context manager, it ends the process."""

    def __init__(self, executable: str, log: Path, **parameters: object) -> None:
        """Start an executable of this environment.

        Args:
            executable: `tracker` or `replay`.
            log: File for its output.
            **parameters: ROS parameters.

        Raises:
            DemoError: The executable is not installed.
        """
        command = [str(_installed(executable)), *ros_arguments(parameters)]
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
        """Exit code of the process; None while it runs."""
        return self._process.poll()

    def check(self) -> None:
        """Check that the process has not failed and has logged no error.

        Raises:
            DemoError: The exit code is not 0, or the log contains an error. A node keeps running
                after an error.
        """
        if self.exit_code:
            raise self.failure(f"`{self.name}` ended with exit code {self.exit_code}")
        if "[ERROR]" in self._log.read_text(errors="replace"):
            raise self.failure(f"`{self.name}` reported an error")

    def failure(self, reason: str) -> DemoError:
        """An error with the end of the log of this process."""
        return DemoError(reason, self._log.read_text(errors="replace"))
