"""Real-time priority, where the system permits it: images and answers wait for no other process."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_CURE = (
    "allow it to its user ('rtprio' in /etc/security/limits.conf) or to its container (the "
    "capability SYS_NICE)"
)


# Threads that take more of a core, over so many seconds, leave too little to others.
_MOST_OF_A_CORE = 0.75
_INTERVAL = 1.0


class RealTimePriority:
    """That of Fast DDS' threads, and of the one that makes this.

    It has to be made once DDS has its threads. Threads that these start later have no priority.

    Attributes:
        in_force: Of DDS' threads, from 1 to 99, or 0 for none.

    Args:
        report: Called with a sentence where a priority that is asked for is not permitted.
        usual: The one that is asked for where nobody has chosen another; where it is not permitted,
            which is usual as well, nothing is told.
    """

    def __init__(self, report: Callable[[str], None], usual: int = 0) -> None:
        self.in_force = 0
        self._report = report
        self._usual = usual
        self._of_dds: Sequence[int] = [
            int(thread.name) for thread in _THREADS.glob("*") if _name(thread).startswith("dds.")
        ]
        self._own = threading.get_native_id()
        self._own_in_force = 0
        self._is_busy = False
        self._looked_at, self._used = time.monotonic(), self._cpu_seconds()

    def ask(self, priority: int) -> None:
        """Ask for a priority, for DDS' threads and for whom they share it with.

        Args:
            priority: From 1 to 99, or 0 for none.
        """
        # Not every system knows of such priorities.
        if priority == self.in_force or not hasattr(os, "sched_setscheduler"):
            return
        try:
            for thread in self._of_dds:
                _set(thread, priority)
        except OSError:
            if priority != self._usual:
                self._report(
                    f"real-time priority {priority} is not permitted to this process: {_CURE}"
                )
        else:
            self.in_force = priority
            self.share(self._own_in_force > 0)

    def share(self, is_shared: bool) -> None:
        """Whether the thread that made this has the priority too, while it leaves time to others.

        To be called by it, again and again.
        """
        if not self.in_force and not self._own_in_force:
            return
        self._look()
        wanted = self.in_force if is_shared and not self._is_busy else 0
        if wanted != self._own_in_force:
            # What was permitted to the others may be no more.
            with suppress(OSError):
                _set(self._own, wanted)
                self._own_in_force = wanted

    def _look(self) -> None:
        """See how much of a core the threads have taken since the last look."""
        now = time.monotonic()
        elapsed = now - self._looked_at
        if elapsed >= _INTERVAL:
            used = self._cpu_seconds()
            self._is_busy = used - self._used > _MOST_OF_A_CORE * elapsed
            self._looked_at, self._used = now, used

    def _cpu_seconds(self) -> float:
        return sum(_cpu_seconds(thread) for thread in [*self._of_dds, self._own])


def _name(thread: Path) -> str:
    # It may have ended.
    with suppress(OSError):
        return (thread / "comm").read_text()
    return ""


def _cpu_seconds(thread: int) -> float:
    # Linux' number for the CPU clock of a thread. It may have ended, or there may be no such clock.
    with suppress(OSError, OverflowError, AttributeError):
        return time.clock_gettime((~thread << 3) | 6)
    return 0.0


def _set(thread: int, priority: int) -> None:
    """Set the priority of a thread; raises OSError where that is not permitted or not possible."""
    policy = os.SCHED_RR if priority else os.SCHED_OTHER
    with suppress(ProcessLookupError):
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
