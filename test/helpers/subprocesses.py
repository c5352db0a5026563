"""What tests of interrupted commands need: other processes, and waiting for what they do."""

import time
from pathlib import Path


def wait_until(condition):
    """Wait for a condition."""
    deadline = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def processes_below(pid, name):
    """The processes below one, at any depth, with a name in their command line."""
    for child in _read(pid, f"task/{pid}/children").split():
        yield from processes_below(int(child), name)
        if name in _read(child, "cmdline"):
            yield int(child)


def is_running(pid):
    """Whether a process runs: it has not ended, even if nobody has waited for it."""
    # "number (name) state ...", Z for one that has ended but was not waited for.
    return _read(pid, "stat").rpartition(")")[2].split()[:1] not in ([], ["Z"])


def _read(pid, name):
    try:
        return Path(f"/proc/{pid}/{name}").read_text()
    except OSError:
        return ""
