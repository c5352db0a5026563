"""Connects browsers with the tracker: topics to messages, requests to topics and services.

Everything here runs in the web server's event loop.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine
from functools import partial
from typing import Any

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.console import player
from pf_tracker_ros.node.console.browsers import Browser, Browsers
from pf_tracker_ros.node.console.frame_synchronizer import FrameSynchronizer
from pf_tracker_ros.node.console.health import TrackerHealth
from pf_tracker_ros.node.console.json_conversions import Json, note
from pf_tracker_ros.node.console.played_recording import STATUS_TIMEOUT, PlayedRecording
from pf_tracker_ros.node.console.player import Player
from pf_tracker_ros.node.console.requests import (
    RequestError,
    boolean_of,
    number_of,
    numbers_of,
    stamp_in,
)
from pf_tracker_ros.node.console.target_requester import TargetRequester, TargetResponse
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.tracker_services import TrackerError
from pf_tracker_ros.node.console.tuning import parameter_file, parameter_from_json
from pf_tracker_ros.tracking.input_checks import check_box

# Polling interval, seconds, for silence and for frames without a status.
_TICK = 0.1
# The subscriptions stay for so long, in seconds, after the last browser has gone. A page that is
# reloaded comes back, and a take in Fast DDS may hang where subscriptions change quickly.
_LINGER = 5.0
# Requests of browsers, each handled by the method of its name. The second group concerns only the
# browser that sends it.
_REQUESTS = ("target", "click", "select", "stop", "stop_target", "enable", "reset")
_OWN_REQUESTS = ("welcome_ack", "frame_ack", "view", "set", "heatmap")


class ConsoleBridge:
    """Forwards the tracker's messages to the browsers, and their requests to the tracker.

    Args:
        link: Topics and services of the tracker.
        recording: The recording that the console plays, if any.
    """

    def __init__(self, link: TrackerLink, recording: PlayedRecording | None = None) -> None:
        self._link = link
        self._synchronizer = FrameSynchronizer(STATUS_TIMEOUT if recording else None)
        self._browsers = Browsers(lambda: self._synchronizer.latest, self._index_of)
        self._heatmap_browsers: set[Browser] = set()
        self._last_watched_at = float("-inf")
        self._required_parts = {"particles": False, "likelihood": False}
        self._health = TrackerHealth(link.name)
        self._last_health: Json = {}
        self._requester = TargetRequester(link, self._broadcast_response)
        self._player: Player | None = None
        self._recordings = recording.list_for_page if recording else []
        if recording:
            self._player = Player(
                recording,
                link,
                self._requester,
                self._browsers.broadcast,
                lambda: self._is_single_target,
            )
        self._parameters: list[Json] = []
        self._parameter_task: asyncio.Task[None] | None = None
        self._parameters_outdated = True
        self._tasks: set[asyncio.Task[None]] = set()
        if self._player:
            self._update_subscriptions()

    async def run(self) -> None:
        """Poll until canceled, so that silence is noticed."""
        while True:
            await self._poll()
            self._update_subscriptions()
            await asyncio.sleep(_TICK)

    def close(self) -> None:
        """Stop the encoder."""
        self._browsers.close()

    def parameter_file(self) -> str:
        """A ROS parameter file with the preset and each value that differs from it.

        Raises:
            RequestError: The tracker's parameters are not known.
        """
        self._parameter("preset")
        return parameter_file(self._link.name, self._parameters)

    # From the tracker

    def receive(self, kind: str, stamp: int, content: Any) -> None:
        """Process a message of the link; see `TrackerLink`."""
        now = time.monotonic()
        if kind == "image":
            self._synchronizer.add_image(stamp, content, now)
        elif kind == "parameters":
            self._parameters_outdated = True
        elif kind == "fault":
            self._health.take_fault(content, now)
        elif kind == "detections":
            message = {"type": "detections", "stamp": str(stamp), "boxes": content}
            self._run_soon(self._browsers.broadcast(message))
        elif kind == "health":
            self._health.take_diagnostics(content, now)
            self._link.set_image_topic(str(content["values"].get("image_topic", "")))
            self._requester.check_diagnostics(content, now)
        elif kind == "status" and self._player and content["values"].get("frame") == "duplicate":
            # Of a frame that the player has repeated for a target: its first result holds.
            self._requester.check_status(content)
        else:
            self._synchronizer.add_result(stamp, kind, content, now)
            if kind == "status":
                self._health.take_status(content, now)
                self._requester.check_status(content)
        self._run_soon(self._poll())

    async def _poll(self) -> None:
        """Send news to the browsers, and resend lost targets."""
        now = time.monotonic()
        if self._synchronizer.choose(now):
            await self._browsers.notify_new_frame()
        health = self._health_summary(now)
        if health != self._last_health:
            self._last_health = health
            await self._browsers.broadcast(health)
        if self._player:
            latest = self._synchronizer.latest
            await self._player.poll(now, latest.stamp if latest else None)
        if health["tracker"] != "alive":
            # The tracker may come back with other values.
            self._parameters_outdated = True
        elif self._parameters_outdated and self._browsers and not self._parameter_task:
            self._parameters_outdated = False
            self._parameter_task = asyncio.ensure_future(self._read_parameters())
        self._requester.poll(
            self._health.last_status_at,
            now,
            may_resend=self._player is None,
            recording_paused=self._recording_paused,
        )

    @property
    def _recording_paused(self) -> bool:
        return self._player is not None and self._player.recording_paused

    def _health_summary(self, now: float) -> Json:
        return self._health.summary(
            now,
            recording_paused=self._recording_paused,
            others=self._link.available_trackers,
            graph_faults=self._link.graph_faults,
        )

    def _index_of(self, stamp: int) -> int | None:
        return self._player.index_of(stamp) if self._player else None

    # Browsers

    async def welcome(self, browser: Browser) -> None:
        """Send a browser the current state and then every frame, until canceled."""
        self._browsers.add(browser)
        self._update_subscriptions()
        news = [
            {
                "type": "welcome",
                "tracker": self._link.name,
                "draw_on_request": browser.is_local,
                "recordings": self._recordings,
            },
            self._health_summary(time.monotonic()),
            *([self._player.state] if self._player else []),
            {"type": "parameters", "parameters": self._parameters},
        ]
        try:
            await self._browsers.stream(browser, news)
        finally:
            self._browsers.remove(browser)
            self._heatmap_browsers.discard(browser)
            self._update_subscriptions()

    async def handle(self, browser: Browser, message: Any) -> None:
        """Carry out a request of a browser; errors go to this browser alone."""
        kind = message.get("type") if isinstance(message, dict) else None
        name = kind if isinstance(kind, str) else ""
        try:
            if name in _OWN_REQUESTS:
                await getattr(self, f"_on_{name}")(browser, message)
            elif name in _REQUESTS:
                await getattr(self, f"_on_{name}")(message)
            elif name not in player.REQUESTS:
                raise RequestError(f"unknown request {kind!r}")
            elif self._player:
                await self._player.handle(name, message)
                if name == "open":
                    # The next picture is of the opened recording.
                    self._synchronizer.clear()
            else:
                raise RequestError("the console plays no recording; start it with 'source'")
        except (RequestError, TrackerError) as error:
            await browser.send_json(note(name or None, str(error), ok=False))

    def _update_subscriptions(self) -> None:
        """Subscribe to the watched topics only."""
        now = time.monotonic()
        # A recording's first frame is sent once, perhaps before the first browser connects.
        is_watched = len(self._browsers) > 0 or self._player is not None
        if is_watched:
            self._last_watched_at = now
        is_watched |= now - self._last_watched_at < _LINGER
        required = {"particles": is_watched, "likelihood": bool(self._heatmap_browsers)}
        if required != self._required_parts:
            self._required_parts = required
            self._link.watch(is_watched)
            self._link.watch_likelihood(bool(self._heatmap_browsers))
            self._synchronizer.required_parts = {part for part, is_on in required.items() if is_on}

    async def _on_welcome_ack(self, browser: Browser, message: Json) -> None:
        self._browsers.end_round_trip(browser)

    async def _on_frame_ack(self, browser: Browser, message: Json) -> None:
        self._browsers.acknowledge(browser)

    async def _on_view(self, browser: Browser, message: Json) -> None:
        await self._browsers.set_width(browser, number_of(message, "width"))

    async def _on_heatmap(self, browser: Browser, message: Json) -> None:
        """Show or hide the likelihood around the target."""
        if message.get("shown") is True and browser in self._browsers:
            self._heatmap_browsers.add(browser)
            text = ""
            latest = self._synchronizer.latest
            status = latest.results.get("status") if latest else None
            if self._last_health.get("state") == "idle":
                text = "the heat map needs a target"
            elif status and status["targets"] and not status["selected"]:
                text = "the heat map shows the selected target; click a target to select it"
            elif self._recording_paused:
                text = "the heat map comes with the next frame: go one frame on, or play"
            if text:
                await browser.send_json(note("heatmap", text))
        else:
            self._heatmap_browsers.discard(browser)
        self._update_subscriptions()

    # Targets

    async def _on_target(self, message: Json) -> None:
        x, y, width, height = numbers_of(message, "box", 4)
        stamp = stamp_in(message)
        box = (x, y, width, height)
        self._check_tracker()
        if not self._player or not await self._start_in_recording(self._player, box, stamp):
            await self._requester.send(partial(self._link.send_target, box, stamp))

    async def _start_in_recording(self, player: Player, box: Box, stamp: int) -> bool:
        """Whether the recording starts a target on its frame; else the target has to be sent."""
        latest = self._synchronizer.latest
        image_size = latest.size if latest else None
        if image_size:
            # Checked here: the restart stops the present target before the tracker can refuse.
            try:
                check_box(box, image_size)
            except ValueError as error:
                raise RequestError(f"target refused: {error}") from error
        return await player.start_from_target(box, stamp, image_size)

    async def _on_click(self, message: Json) -> None:
        x, y = numbers_of(message, "point", 2)
        stamp = stamp_in(message)
        if self._player:
            # The player stores targets as boxes.
            size = self._parameter("click_size")["value"]
            box = [x - size / 2, y - size / 2, size, size]
            await self._on_target({"box": box, "stamp": message["stamp"]})
            return
        self._check_tracker()
        await self._requester.send(partial(self._link.send_click, x, y, stamp))

    def _check_tracker(self) -> None:
        """Refuse a target for a silent tracker; DDS may still list a node that has ended."""
        if self._last_health.get("tracker") == "silent":
            raise RequestError(
                "nothing was sent: the tracker is silent; send it again once it is back"
            )

    async def _on_stop(self, message: Json) -> None:
        discarded = self._player.clear_targets() if self._player else ""
        reply = await self._link.services.stop()
        await self._browsers.broadcast(note("stop", discarded or reply))

    async def _on_stop_target(self, message: Json) -> None:
        await self._send_id("stop_target", message, "stops with the next image")

    async def _on_select(self, message: Json) -> None:
        await self._send_id("select", message, "is selected")

    async def _send_id(self, topic: str, message: Json, what: str) -> None:
        id = str(message.get("id"))
        try:
            self._link.send_id(topic, id)
        except ValueError as error:
            raise RequestError(str(error)) from error
        named = f"target {id}" if id.strip("0") else "no target"
        await self._browsers.broadcast(note(topic, f"{named} {what}"))

    async def _on_enable(self, message: Json) -> None:
        enabled = boolean_of(message, "enabled")
        reply = await self._link.services.enable(enabled)
        await self._browsers.broadcast(note("enable", reply))

    def _broadcast_response(self, response: TargetResponse) -> None:
        if self._player and response.outcome == "refused":
            self._player.remove_last_target()
        message = {"type": "target_response", "outcome": response.outcome, "text": response.text}
        self._run_soon(self._browsers.broadcast(message))

    # Parameters

    async def _on_set(self, browser: Browser, message: Json) -> None:
        """Set a parameter; a refusal goes to the field that it was entered in."""
        name = message.get("name")
        known = self._parameter(name, f"unknown parameter {name!r}")
        try:
            parameter = parameter_from_json(known, message.get("value"))
            refusal = await self._link.services.set_parameter(parameter)
        except (ValueError, TrackerError) as error:
            refusal = str(error)
        else:
            refusal = refusal and f"{refusal}; it stays {known['value']}"
        await browser.send_json({"type": "set", "name": name, "refusal": refusal})

    async def _on_reset(self, message: Json) -> None:
        """Set the preset to its present value, which restores all values of the preset."""
        known = self._parameter("preset")
        if refusal := await self._link.services.set_parameter(
            parameter_from_json(known, known["value"])
        ):
            raise RequestError(refusal)
        text = f"the tracker has the values of the preset {known['value']}"
        text += "; the node's own parameters are unchanged"
        await self._browsers.broadcast(note("reset", text))

    @property
    def _is_single_target(self) -> bool:
        return not any(
            one["name"] == "max_targets" and one["value"] > 1 for one in self._parameters
        )

    def _parameter(
        self, name: Any, error: str = "the tracker's parameters are not known yet"
    ) -> Json:
        """A parameter of the tracker by its name.

        Raises:
            RequestError: There is none; the message is `error`.
        """
        for one in self._parameters:
            if one["name"] == name:
                return one
        raise RequestError(error)

    async def _read_parameters(self) -> None:
        try:
            self._parameters = await self._link.services.parameters()
        except TrackerError:
            self._parameters_outdated = True
            await asyncio.sleep(_TICK)
        else:
            await self._browsers.broadcast({"type": "parameters", "parameters": self._parameters})
        finally:
            self._parameter_task = None

    def _run_soon(self, action: Coroutine[Any, Any, None]) -> None:
        # The loop keeps only weak references to tasks.
        task = asyncio.ensure_future(action)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
