"""What the tracker makes of a target that was picked, read from its statuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.node.console.answers import Json

_REFUSED = "target refused"
# A frame that is answered so much later, in seconds, would have told of the target.
_ANSWERED_AFTER = 0.5
_MOST_ATTEMPTS = 4


@dataclass(frozen=True)
class Verdict:
    """What became of a target.

    Attributes:
        outcome: `accepted` or `refused`.
        text: One sentence, of a refused one the node's own.
    """

    outcome: str
    text: str


class Pick:
    """A target that has been sent and not been answered.

    Attributes:
        number: Which one, counted from 1.
        sent_at: Seconds by any clock that is always the same.

    Args:
        number: As the attribute.
        sent_at: As the attribute.
        send: Sends it.
    """

    def __init__(self, number: int, sent_at: float, send: Callable[[], None]) -> None:
        self.number = number
        self.sent_at = sent_at
        self._send = send
        self._attempts = 1
        self._tried_at = sent_at

    def send_again(self, answered_at: float, now: float) -> None:
        """Send it again if frames have been answered since, and none of them told of it.

        What is sent while two sides get to know each other may be lost.

        Args:
            answered_at: When the last frame was, by the clock of `sent_at`.
            now: By the same clock.
        """
        if answered_at - self._tried_at > _ANSWERED_AFTER and self._attempts < _MOST_ATTEMPTS:
            self._attempts += 1
            self._tried_at = now
            self._send()

    def judge_status(self, status: Json) -> Verdict | None:
        """The verdict in the status of a frame, None if it has none."""
        message = str(status["message"])
        if _REFUSED in message:
            return Verdict("refused", message[message.index(_REFUSED) :])
        if status["values"].get("frame") == "started":
            return Verdict("accepted", "accepted; the tracker follows it")
        return None

    def judge_health(self, health: Json, now: float) -> Verdict | None:
        """The verdict in the node's diagnostics, which come without images too.

        Args:
            health: As `answers.status_of` gives it.
            now: As `sent_at`.
        """
        values: dict[str, Any] = health["values"]
        error, age = str(values.get("last_error", "")), values.get("seconds_since_error")
        is_new = isinstance(age, float) and age < now - self.sent_at
        if is_new and error.startswith(_REFUSED):
            return Verdict("refused", error)
        return None
