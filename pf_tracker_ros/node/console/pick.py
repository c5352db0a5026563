"""Targets that are sent to the tracker, and what it makes of them, read from its statuses."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.node.console.answers import Json
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.tracker_services import TrackerError

_REFUSED = "target refused"
# A frame that is answered so much later, in seconds, would have told of the target.
_ANSWERED_AFTER = 0.5
_MOST_ATTEMPTS = 4
# A target that nothing has been heard of for so long waits for an image.
_PATIENCE = 3.0
# The same where no image comes by itself, which a target that is tried needs none of.
_PATIENCE_STILL = 1.0
_TICK = 0.1
# As of the services.
_MEETING_TICKS = 50


@dataclass(frozen=True)
class Verdict:
    """What became of a target.

    Attributes:
        outcome: `accepted`, `refused` or, before either, `waiting`.
        text: One sentence, of a refused one the node's own.
    """

    outcome: str
    text: str


def verdict_of_frame(status: Json) -> Verdict | None:
    """The verdict in the status of a frame, None if it has none."""
    message = str(status["message"])
    if _REFUSED in message:
        return Verdict("refused", message[message.index(_REFUSED) :])
    if status["values"].get("frame") == "started":
        return Verdict("accepted", "accepted; the tracker follows it")
    return None


def verdict_of_health(health: Json, sent_for: float) -> Verdict | None:
    """The verdict in the node's diagnostics, which come without images too.

    Args:
        health: As `answers.status_of` gives it.
        sent_for: Seconds since the target was sent.
    """
    values: dict[str, Any] = health["values"]
    error, age = str(values.get("last_error", "")), values.get("seconds_since_error")
    is_new = isinstance(age, float) and age < sent_for
    return Verdict("refused", error) if is_new and error.startswith(_REFUSED) else None


@dataclass
class _Pick:
    """A target that has been sent and not been answered; times by `time.monotonic`."""

    send: Callable[[], None]
    sent_at: float
    tried_at: float
    attempts: int = 1
    is_waiting: bool = False


class Picker:
    """Sends targets, one after another, and tells what becomes of the last.

    Args:
        link: To the tracker.
        tell: Called with each verdict.
    """

    def __init__(self, link: TrackerLink, tell: Callable[[Verdict], None]) -> None:
        self._link = link
        self._tell = tell
        self._pick: _Pick | None = None

    async def send(self, send: Callable[[], None], *, is_sent_later: bool = False) -> None:
        """Send a target, and expect a verdict on it.

        Args:
            send: Does so, and again where it may have been lost.
            is_sent_later: Whether somebody else sends it at first, in a moment.

        Raises:
            TrackerError: Nobody takes targets.
        """
        # A tracker that has just been found may not be known to take any yet.
        for _ in range(_MEETING_TICKS):
            if self._link.takes_targets:
                break
            await asyncio.sleep(_TICK)
        if is_sent_later:
            self._link.expect_takers()
        else:
            send()
        now = time.monotonic()
        self._pick = _Pick(send, now, now)

    def judge_status(self, status: Json) -> None:
        """Look for the verdict in the status of a frame."""
        self._conclude(verdict_of_frame(status))

    def judge_health(self, health: Json, now: float) -> None:
        """Look for the verdict in the node's diagnostics, at a time by `time.monotonic`."""
        if self._pick:
            self._conclude(verdict_of_health(health, now - self._pick.sent_at))

    def look(
        self, answered_at: float, now: float, *, may_repeat: bool, stands_still: bool = False
    ) -> None:
        """Send again what was lost, and tell what waits for an image.

        What is sent while two sides get to know each other may be lost: frames have been answered
        since then, and none of them told of it.

        Args:
            answered_at: When the last frame was answered, by `time.monotonic`.
            now: By the same clock.
            may_repeat: Whether the target may be sent again.
            stands_still: Whether no image comes until somebody lets the recording go on.
        """
        pick = self._pick
        if pick is None:
            return
        is_lost = answered_at - pick.tried_at > _ANSWERED_AFTER
        if may_repeat and is_lost and pick.attempts < _MOST_ATTEMPTS:
            pick.attempts, pick.tried_at = pick.attempts + 1, now
            with contextlib.suppress(TrackerError):
                pick.send()
        patience = _PATIENCE_STILL if stands_still else _PATIENCE
        if not pick.is_waiting and now - pick.sent_at > patience:
            pick.is_waiting = True
            cure = ": press N for it, or play" if stands_still else ""
            self._tell(Verdict("waiting", f"sent; the tracker answers with the next image{cure}"))

    def _conclude(self, verdict: Verdict | None) -> None:
        if verdict and self._pick:
            self._pick = None
            self._tell(verdict)
