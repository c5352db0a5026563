"""Targets that are sent to the tracker, and what it makes of them, read from its statuses."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pf_tracker_ros.node.console.json_conversions import Json
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
class TargetResponse:
    """What became of a target.

    Attributes:
        outcome: `accepted`, `refused` or, before either, `waiting`.
        text: One sentence, of a refused one the node's own.
    """

    outcome: str
    text: str


def response_from_status(status: Json) -> TargetResponse | None:
    """The verdict in the status of a frame, None if it has none."""
    message = str(status["message"])
    if _REFUSED in message:
        return TargetResponse("refused", message[message.index(_REFUSED) :])
    if status["values"].get("frame") == "started":
        return TargetResponse("accepted", "accepted; the tracker follows it")
    return None


def response_from_diagnostics(health: Json, sent_for: float) -> TargetResponse | None:
    """The verdict in the node's diagnostics, which come without images too.

    Args:
        health: As `answers.diagnostic_status_to_json` gives it.
        sent_for: Seconds since the target was sent.
    """
    values: dict[str, Any] = health["values"]
    error, age = str(values.get("last_error", "")), values.get("seconds_since_error")
    is_new = isinstance(age, float) and age < sent_for
    return TargetResponse("refused", error) if is_new and error.startswith(_REFUSED) else None


@dataclass
class _Pick:
    """A target that has been sent and not been answered; times by `time.monotonic`."""

    send: Callable[[], None]
    sent_at: float
    tried_at: float
    attempts: int = 1
    is_waiting: bool = False


class TargetRequester:
    """Sends targets, one after another, and tells what becomes of the last.

    Args:
        link: To the tracker.
        tell: Called with each verdict.
    """

    def __init__(self, link: TrackerLink, tell: Callable[[TargetResponse], None]) -> None:
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
            if self._link.has_target_subscribers:
                break
            await asyncio.sleep(_TICK)
        if is_sent_later:
            self._link.require_target_subscriber()
        else:
            send()
        now = time.monotonic()
        self._pick = _Pick(send, now, now)

    def check_status(self, status: Json) -> None:
        """Look for the verdict in the status of a frame."""
        self._conclude(response_from_status(status))

    def check_diagnostics(self, health: Json, now: float) -> None:
        """Look for the verdict in the node's diagnostics, at a time by `time.monotonic`."""
        if self._pick:
            self._conclude(response_from_diagnostics(health, now - self._pick.sent_at))

    def poll(
        self, last_status_at: float, now: float, *, may_resend: bool, recording_paused: bool = False
    ) -> None:
        """Send again what was lost, and tell what waits for an image.

        What is sent while two sides get to know each other may be lost: frames have been answered
        since then, and none of them told of it.

        Args:
            last_status_at: When the last frame was answered, by `time.monotonic`.
            now: By the same clock.
            may_resend: Whether the target may be sent again.
            recording_paused: Whether no image comes until somebody lets the recording go on.
        """
        pick = self._pick
        if pick is None:
            return
        is_lost = last_status_at - pick.tried_at > _ANSWERED_AFTER
        if may_resend and is_lost and pick.attempts < _MOST_ATTEMPTS:
            pick.attempts, pick.tried_at = pick.attempts + 1, now
            with contextlib.suppress(TrackerError):
                pick.send()
        patience = _PATIENCE_STILL if recording_paused else _PATIENCE
        if not pick.is_waiting and now - pick.sent_at > patience:
            pick.is_waiting = True
            cure = ": press N for it, or play" if recording_paused else ""
            self._tell(
                TargetResponse("waiting", f"sent; the tracker answers with the next image{cure}")
            )

    def _conclude(self, verdict: TargetResponse | None) -> None:
        if verdict and self._pick:
            self._pick = None
            self._tell(verdict)
