"""What the demo says when a step fails."""

from __future__ import annotations


class DemoError(Exception):
    """A step that failed; the message says why, `details` holds the end of a log."""

    def __init__(self, reason: str, log: str = "", lines: int = 15) -> None:
        """Keep the reason and the last `lines` lines of `log`."""
        super().__init__(reason)
        self.details = "\n".join(log.strip().splitlines()[-lines:])
