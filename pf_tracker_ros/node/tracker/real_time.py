"""Real-time priority, where the system permits it: images and answers wait for no other process."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_CURE = (
    "allow it to its user ('rtprio' in /etc/security/limits.conf) or to its container (the "
    "capability SYS_NICE)"
)


class RealTimePriority:
    """That of Fast DDS' threads, and of the one that makes this.

    It has to be made once DDS has its threads. Threads that these start later have no priority.

    Attributes:
        in_force: Of DDS' threads, from 1 to 99, or 0 for none.

    Args:
        report: Called with a sentence where a priority that is asked for is not permitted.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.in_force = 0
        self._report = report
        self._of_dds: Sequence[int] = [
            int(thread.name) for thread in _THREADS.glob("*") if _name(thread).startswith("dds.")
        ]
        self._own = threading.get_native_id()
        self._own_in_force = 0

    def ask(self, priority: int) -> None:
        """Ask for a priority for DDS' threads.

        Args:
            priority: From 1 to 99, or 0 for none.
        """
        # Not every system knows of such priorities.
        if not hasattr(os, "sched_setscheduler"):
            return
        try:
            for thread in self._of_dds:
                _set(thread, priority)
        except OSError:
            self._report(f"real-time priority {priority} is not permitted to this process: {_CURE}")
        else:
            self.in_force = priority

    def share(self, is_shared: bool) -> None:
        """Whether the thread that made this has the priority too, from now on."""
        wanted = self.in_force if is_shared else 0
        if wanted != self._own_in_force:
            self._own_in_force = wanted
            # What was permitted to the others may be no more.
            with suppress(OSError):
                _set(self._own, wanted)


def _name(thread: Path) -> str:
    # It may have ended.
    with suppress(OSError):
        return (thread / "comm").read_text()
    return ""


def _set(thread: int, priority: int) -> None:
    """Set the priority of a thread; raises OSError where that is not permitted or not possible."""
    policy = os.SCHED_RR if priority else os.SCHED_OTHER
    with suppress(ProcessLookupError):
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
