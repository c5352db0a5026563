"""Sends targets to the tracker, and reads its response from status and diagnostics."""

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
# A target counts as lost if a status follows this much later, in seconds, without a response.
_LOST_AFTER = 0.5
_MAX_ATTEMPTS = 4
# Seconds without a response until the outcome is `waiting`; the same while a recording is paused.
_TIMEOUT = 3.0
_TIMEOUT_PAUSED = 1.0
_TICK = 0.1
# Discovery takes as long as for the services.
_DISCOVERY_TICKS = 50


@dataclass(frozen=True)
class TargetResponse:
    """The tracker's response to a target.

    Attributes:
        outcome: `accepted`, `refused` or, before either, `waiting`.
        text: One sentence; of a refusal, the node's own.
    """

    outcome: str
    text: str


def response_from_status(status: Json) -> TargetResponse | None:
    """The response in the status of a frame, None if it has none."""
    message = str(status["message"])
    if _REFUSED in message:
        return TargetResponse("refused", message[message.index(_REFUSED) :])
    if status["values"].get("frame") == "started":
        return TargetResponse("accepted", "accepted; the target is tracked")
    return None


def response_from_diagnostics(health: Json, sent_for: float) -> TargetResponse | None:
    """The response in the node's diagnostics, which come without images too.

    Args:
        health: As from `json_conversions.diagnostic_status_to_json`.
        sent_for: Seconds since the target was sent.
    """
    values: dict[str, Any] = health["values"]
    error, age = str(values.get("last_error", "")), values.get("seconds_since_error")
    is_new = isinstance(age, float) and age < sent_for
    return TargetResponse("refused", error) if is_new and error.startswith(_REFUSED) else None


@dataclass
class _PendingTarget:
    """A target without a response yet; times by `time.monotonic`."""

    send: Callable[[], None]
    sent_at: float
    last_sent_at: float
    attempts: int = 1
    is_waiting: bool = False


class TargetRequester:
    """Sends targets, and reports the response to the last one.

    Args:
        link: Topics of the tracker.
        report: Called with each response.
    """

    def __init__(self, link: TrackerLink, report: Callable[[TargetResponse], None]) -> None:
        self._link = link
        self._report = report
        self._pending: _PendingTarget | None = None

    async def send(self, send: Callable[[], None], *, is_sent_later: bool = False) -> None:
        """Send a target, and wait for the response in later statuses.

        Args:
            send: Sends it; called again if it was lost.
            is_sent_later: Whether the caller sends it the first time, with its frame.

        Raises:
            TrackerError: No node subscribes to targets.
        """
        # The subscriptions of a tracker may be discovered later than the node.
        for _ in range(_DISCOVERY_TICKS):
            if self._link.has_target_subscribers:
                break
            await asyncio.sleep(_TICK)
        if is_sent_later:
            self._link.require_target_subscriber()
        else:
            send()
        now = time.monotonic()
        self._pending = _PendingTarget(send, now, now)

    def check_status(self, status: Json) -> None:
        """Look for the response in the status of a frame."""
        self._conclude(response_from_status(status))

    def check_diagnostics(self, health: Json, now: float) -> None:
        """Look for the response in the node's diagnostics; `now` is by `time.monotonic`."""
        if self._pending:
            self._conclude(response_from_diagnostics(health, now - self._pending.sent_at))

    def poll(
        self, last_status_at: float, now: float, *, may_resend: bool, recording_paused: bool = False
    ) -> None:
        """Resend a lost target, and report one that waits for an image.

        A message may be lost during discovery: later statuses then have no response to it.

        Args:
            last_status_at: Time of the last status, by `time.monotonic`.
            now: By the same clock.
            may_resend: Whether the target may be sent again.
            recording_paused: Whether a recording is paused, so that no image comes.
        """
        pending = self._pending
        if pending is None:
            return
        is_lost = last_status_at - pending.last_sent_at > _LOST_AFTER
        if may_resend and is_lost and pending.attempts < _MAX_ATTEMPTS:
            pending.attempts, pending.last_sent_at = pending.attempts + 1, now
            with contextlib.suppress(TrackerError):
                pending.send()
        timeout = _TIMEOUT_PAUSED if recording_paused else _TIMEOUT
        if not pending.is_waiting and now - pending.sent_at > timeout:
            pending.is_waiting = True
            hint = ": go one frame on, or play" if recording_paused else ""
            self._report(
                TargetResponse("waiting", f"sent; the tracker starts it on the next image{hint}")
            )

    def _conclude(self, response: TargetResponse | None) -> None:
        if response and self._pending:
            self._pending = None
            self._report(response)
