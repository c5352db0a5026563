"""Real-time priority of the process, where the system permits it: answers wait for nobody else."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_CURE = (
    "allow it to its user ('rtprio' in /etc/security/limits.conf) or to its container (the "
    "capability SYS_NICE)"
)


class RealTimePriority:
    """That of the threads that there are when it is made; those that they start later have none.

    So it has to be made once DDS has its threads, and before anything begins that may take long.

    Attributes:
        in_force: From 1 to 99, or 0 for none.

    Args:
        report: Called with a sentence where a priority that is asked for is not permitted.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.in_force = 0
        self._report = report
        self._threads: Sequence[int] = [int(thread.name) for thread in _THREADS.glob("*")]
        self._wanted = 0
        self._is_permitted = True

    def ask(self, priority: int) -> None:
        """Ask for a priority.

        Args:
            priority: From 1 to 99, or 0 for none.
        """
        # Not every system knows of such priorities.
        self._wanted, self._is_permitted = priority, hasattr(os, "sched_setscheduler")
        self._take(priority)

    def look(self, *, is_overloaded: bool) -> None:
        """Give it up while there is no time left: others would get next to nothing.

        Args:
            is_overloaded: Whether frames take all the time of a core.
        """
        self._take(0 if is_overloaded else self._wanted)

    def _take(self, priority: int) -> None:
        if priority == self.in_force or not self._is_permitted:
            return
        policy = os.SCHED_RR if priority else os.SCHED_OTHER
        try:
            for thread in self._threads:
                # It may have ended.
                with suppress(ProcessLookupError):
                    os.sched_setscheduler(
                        thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority)
                    )
        except PermissionError:
            self._is_permitted = False
            self._report(f"real-time priority {priority} is not permitted to this process: {_CURE}")
        else:
            self.in_force = priority
