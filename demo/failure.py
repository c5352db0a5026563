"""The error of a failed step of the demo."""

from __future__ import annotations


class DemoError(Exception):
    """A step failed. The message is the reason, `details` the end of a log."""

    def __init__(self, reason: str, log: str = "", lines: int = 15) -> None:
        """Store the reason and the last `lines` lines of `log`."""
        super().__init__(reason)
        self.details = "\n".join(log.strip().splitlines()[-lines:])
