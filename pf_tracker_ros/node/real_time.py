"""Real-time priority for Fast DDS, where it is asked for, so that no image waits."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_CURE = (
    "allow it to its user ('rtprio' in /etc/security/limits.conf) or to its container (the "
    "capability SYS_NICE)"
)


class RealTimePriority:
    """That of Fast DDS' threads in this process.

    What they do is little, and no more than others send. It has to be made once DDS has its
    threads. Threads that these start later have no priority. A thread that has been given a policy
    of its own, such as by `chrt`, keeps it.

    Attributes:
        granted: From 1 to 99, or 0 for none.

    Args:
        report: Called with a sentence where a priority that is asked for is not permitted.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.granted = 0
        self._report = report
        of_dds = [int(path.name) for path in _THREADS.glob("*") if _name(path).startswith("dds.")]
        self._threads = [thread for thread in of_dds if _has_usual_policy(thread)]

    def request_priority(self, priority: int) -> None:
        """Ask for a priority.

        Args:
            priority: From 1 to 99, or 0 for none.
        """
        if priority == self.granted or not self._threads:
            return
        try:
            for thread in self._threads:
                _set(thread, priority)
        except OSError:
            self._report(f"real-time priority {priority} is not permitted to this process: {_CURE}")
        else:
            self.granted = priority


def _name(thread: Path) -> str:
    # It may have ended.
    with suppress(OSError):
        return (thread / "comm").read_text()
    return ""


def _has_usual_policy(thread: int) -> bool:
    # It may have ended, and not every system knows of such policies.
    with suppress(OSError, AttributeError):
        return os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
    return False


def _set(thread: int, priority: int) -> None:
    """Set the priority of a thread; raises OSError where that is not permitted or not possible."""
    policy = os.SCHED_RR if priority else os.SCHED_OTHER
    with suppress(ProcessLookupError):
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
