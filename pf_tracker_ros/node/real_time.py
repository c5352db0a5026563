"""Real-time priority for the threads of Fast DDS, on request, so that images do not wait."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_THREADS = Path("/proc/self/task")
_REMEDY = (
    "grant it to the user ('rtprio' in /etc/security/limits.conf) or to the container (capability "
    "SYS_NICE)"
)


class RealTimePriority:
    """Real-time priority of the threads of Fast DDS in this process.

    Their load is small and limited by the received data. Create it once DDS has its threads. Their
    later child threads have no priority. A thread with another policy, such as by `chrt`, keeps it.

    Attributes:
        granted: The present priority, 1 to 99, or 0 for none.

    Args:
        report: Called with a sentence if a requested priority is not permitted.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self.granted = 0
        self._report = report
        dds_threads = [
            int(path.name) for path in _THREADS.glob("*") if _name(path).startswith("dds.")
        ]
        self._threads = [thread for thread in dds_threads if _has_default_policy(thread)]

    def request_priority(self, priority: int) -> None:
        """Request a priority; a refusal is reported.

        Args:
            priority: 1 to 99, or 0 for none.
        """
        if priority == self.granted or not self._threads:
            return
        try:
            for thread in self._threads:
                _set(thread, priority)
        except OSError:
            self._report(
                f"real-time priority {priority} is not permitted for this process: {_REMEDY}"
            )
        else:
            self.granted = priority


def _name(thread: Path) -> str:
    # The thread may have ended.
    with suppress(OSError):
        return (thread / "comm").read_text()
    return ""


def _has_default_policy(thread: int) -> bool:
    # The thread may have ended, or the system may have no such policies.
    with suppress(OSError, AttributeError):
        return os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
    return False


def _set(thread: int, priority: int) -> None:
    """Set the priority of a thread; raises OSError if that is not permitted."""
    policy = os.SCHED_RR if priority else os.SCHED_OTHER
    with suppress(ProcessLookupError):
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
