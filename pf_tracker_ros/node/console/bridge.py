"""Brings browsers and the tracker together; everything here runs in the web server's event loop."""

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
from pf_tracker_ros.node.console.played_recording import PlayedRecording
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

# How often is looked at what does not come by itself: silence, and frames without an answer.
_TICK = 0.1
# For so long, in seconds, frames are still taken once the last browser has gone: it may come back,
# as by a reload, and where subscriptions come and go quickly a take in Fast DDS may never end.
_LINGER = 5.0
# What browsers may ask; each is done by the method of its name. Those of the second kind are about
# the browser that asks.
_REQUESTS = ("target", "click", "select", "stop", "stop_target", "enable", "reset")
_OWN_REQUESTS = ("welcome_ack", "frame_ack", "view", "set", "heatmap")


class ConsoleBridge:
    """Hands on what the tracker says to the browsers, and what they ask to the tracker.

    Args:
        link: To the tracker.
        recording: That is played to it, if one is.
    """

    def __init__(self, link: TrackerLink, recording: PlayedRecording | None = None) -> None:
        self._link = link
        self._pairing = FrameSynchronizer()
        self._browsers = Browsers(lambda: self._pairing.latest)
        self._heated: set[Browser] = set()
        self._watched_at = float("-inf")
        self._wanted = {"particles": False, "likelihood": False}
        self._health = TrackerHealth(link.name)
        self._told_health: Json = {}
        self._picker = TargetRequester(link, self._tell_verdict)
        self._player: Player | None = None
        if recording:
            self._player = Player(
                recording, link, self._picker, self._browsers.broadcast, lambda: self._is_for_one
            )
        self._parameters: list[Json] = []
        self._reading: asyncio.Task[None] | None = None
        self._parameters_are_old = True
        self._tasks: set[asyncio.Task[None]] = set()
        if self._player:
            self._watch()

    async def run(self) -> None:
        """Notice silence, until canceled."""
        while True:
            await self._look()
            self._watch()
            await asyncio.sleep(_TICK)

    def close(self) -> None:
        """Encode no more."""
        self._browsers.close()

    def parameter_file(self) -> str:
        """The preset and what differs from it, as a ROS parameter file.

        Raises:
            RequestError: The tracker's parameters are not known.
        """
        self._known("preset")
        return parameter_file(self._link.name, self._parameters)

    # What comes from the tracker

    def receive(self, kind: str, stamp: int, content: Any) -> None:
        """Take what the link received; see `TrackerLink`."""
        now = time.monotonic()
        if kind == "image":
            self._pairing.add_image(stamp, content, now)
        elif kind == "parameters":
            self._parameters_are_old = True
        elif kind == "fault":
            self._health.take_fault(content, now)
        elif kind == "detections":
            told = {"type": "detections", "stamp": str(stamp), "boxes": content}
            self._soon(self._browsers.broadcast(told))
        elif kind == "health":
            self._health.take_diagnostics(content, now)
            self._link.set_image_topic(str(content["values"].get("image_topic", "")))
            self._picker.check_diagnostics(content, now)
        else:
            self._pairing.add_result(stamp, kind, content, now)
        if kind == "status":
            self._health.take_status(content, now)
            self._picker.check_status(content)
        self._soon(self._look())

    async def _look(self) -> None:
        """Tell the browsers what is new."""
        now = time.monotonic()
        if self._pairing.choose(now):
            await self._browsers.notify_new_frame()
        health = self._told_by_health(now)
        if health != self._told_health:
            self._told_health = health
            await self._browsers.broadcast(health)
        if self._player:
            await self._player.poll(now, has_picture=self._pairing.latest is not None)
        if health["tracker"] != "heard":
            # It may come back with others.
            self._parameters_are_old = True
        elif self._parameters_are_old and self._browsers and not self._reading:
            self._parameters_are_old = False
            self._reading = asyncio.ensure_future(self._read_parameters())
        self._picker.poll(
            self._health.last_status_at,
            now,
            may_resend=self._player is None,
            recording_paused=self._stands_still,
        )

    @property
    def _stands_still(self) -> bool:
        return self._player is not None and self._player.recording_paused

    def _told_by_health(self, now: float) -> Json:
        return self._health.summary(
            now,
            recording_paused=self._stands_still,
            others=self._link.available_trackers,
            graph_faults=self._link.graph_faults,
        )

    # Browsers

    async def welcome(self, browser: Browser) -> None:
        """Show everything to a browser, until canceled."""
        self._browsers.add(browser)
        self._watch()
        news = [
            {"type": "welcome", "tracker": self._link.name, "draw_on_request": browser.is_local},
            self._told_by_health(time.monotonic()),
            *([self._player.state] if self._player else []),
            {"type": "parameters", "parameters": self._parameters},
        ]
        try:
            await self._browsers.stream(browser, news)
        finally:
            self._browsers.remove(browser)
            self._heated.discard(browser)
            self._watch()

    async def handle(self, browser: Browser, message: Any) -> None:
        """Do what a browser asks; what goes wrong is told to it alone."""
        kind = message.get("type") if isinstance(message, dict) else None
        name = kind if isinstance(kind, str) else ""
        try:
            if name in _OWN_REQUESTS:
                await getattr(self, f"_on_{name}")(browser, message)
            elif name in _REQUESTS:
                await getattr(self, f"_on_{name}")(message)
            elif name not in player.REQUESTS:
                raise RequestError(f"there is no request {kind!r}")
            elif self._player:
                await self._player.handle(name, message)
            else:
                raise RequestError("there is no recording; start the console with one")
        except (RequestError, TrackerError) as error:
            await browser.send_json(note(name or None, str(error), ok=False))

    def _watch(self) -> None:
        """Let the tracker publish what somebody looks at, and no more."""
        now = time.monotonic()
        # A recording's first frame comes once, perhaps before the first browser.
        is_watched = len(self._browsers) > 0 or self._player is not None
        if is_watched:
            self._watched_at = now
        is_watched |= now - self._watched_at < _LINGER
        wanted = {"particles": is_watched, "likelihood": bool(self._heated)}
        if wanted != self._wanted:
            self._wanted = wanted
            self._link.watch(is_watched)
            self._link.watch_likelihood(bool(self._heated))
            self._pairing.required_parts = {part for part, is_wanted in wanted.items() if is_wanted}

    async def _on_welcome_ack(self, browser: Browser, message: Json) -> None:
        self._browsers.end_round_trip(browser)

    async def _on_frame_ack(self, browser: Browser, message: Json) -> None:
        self._browsers.acknowledge(browser)

    async def _on_view(self, browser: Browser, message: Json) -> None:
        await self._browsers.set_width(browser, number_of(message, "width"))

    async def _on_heatmap(self, browser: Browser, message: Json) -> None:
        """Show the likelihood around the target, or hide it."""
        if message.get("shown") is True and browser in self._browsers:
            self._heated.add(browser)
            text = ""
            latest = self._pairing.latest
            status = latest.answer.get("status") if latest else None
            if self._told_health.get("state") == "idle":
                text = "the heat map needs a target"
            elif status and status["targets"] and not status["selected"]:
                text = "the heat map shows the selected target; click a target to select it"
            elif self._stands_still:
                text = "the heat map comes with the next frame: press N, or play"
            if text:
                await browser.send_json(note("heatmap", text))
        else:
            self._heated.discard(browser)
        self._watch()

    # Targets

    async def _on_target(self, message: Json) -> None:
        x, y, width, height = numbers_of(message, "box", 4)
        stamp = stamp_in(message)
        box = (x, y, width, height)
        self._check_tracker()
        if not self._player or not await self._is_tried(self._player, box, stamp):
            await self._picker.send(partial(self._link.send_target, box, stamp))

    async def _is_tried(self, player: Player, box: Box, stamp: int) -> bool:
        """Whether the recording goes on from the frame that a target was drawn on."""
        latest = self._pairing.latest
        image_size = latest.size if latest else None
        if image_size:
            # The target there is would be gone before the tracker refuses this one.
            try:
                check_box(box, image_size)
            except ValueError as error:
                raise RequestError(f"target refused: {error}") from error
        return await player.start_from_target(box, stamp, image_size)

    async def _on_click(self, message: Json) -> None:
        x, y = numbers_of(message, "point", 2)
        stamp = stamp_in(message)
        if self._player:
            # To be tried again, it has to be a box.
            size = self._known("click_size")["value"]
            box = [x - size / 2, y - size / 2, size, size]
            await self._on_target({"box": box, "stamp": message["stamp"]})
            return
        self._check_tracker()
        await self._picker.send(partial(self._link.send_click, x, y, stamp))

    def _check_tracker(self) -> None:
        """Refuse a target that nobody is there for; what DDS knows of one that has ended is old."""
        if self._told_health.get("tracker") == "silent":
            raise RequestError(
                "nothing was sent: the tracker has fallen silent; Enter sends it again"
            )

    async def _on_stop(self, message: Json) -> None:
        due = self._player.clear_targets() if self._player else ""
        answer = await self._link.services.stop()
        await self._browsers.broadcast(note("stop", due or answer))

    async def _on_stop_target(self, message: Json) -> None:
        await self._name_target("stop_target", message, "is to stop")

    async def _on_select(self, message: Json) -> None:
        await self._name_target("select", message, "is to be selected")

    async def _name_target(self, topic: str, message: Json, what: str) -> None:
        id = str(message.get("id"))
        try:
            self._link.send_id(topic, id)
        except ValueError as error:
            raise RequestError(str(error)) from error
        named = f"target {id}" if id.strip("0") else "no target"
        await self._browsers.broadcast(note(topic, f"{named} {what}"))

    async def _on_enable(self, message: Json) -> None:
        enabled = boolean_of(message, "enabled")
        answer = await self._link.services.enable(enabled)
        await self._browsers.broadcast(note("enable", answer))

    def _tell_verdict(self, verdict: TargetResponse) -> None:
        if self._player and verdict.outcome == "refused":
            self._player.remove_last_target()
        told = {"type": "target_response", "outcome": verdict.outcome, "text": verdict.text}
        self._soon(self._browsers.broadcast(told))

    # Parameters

    async def _on_set(self, browser: Browser, message: Json) -> None:
        """Set a parameter; a refusal is for the field that it was given in."""
        name = message.get("name")
        known = self._known(name, f"there is no parameter {name!r}")
        try:
            wanted = parameter_from_json(known, message.get("value"))
            refusal = await self._link.services.set_parameter(wanted)
        except (ValueError, TrackerError) as error:
            refusal = str(error)
        else:
            refusal = refusal and f"{refusal}; it stays {known['value']}"
        await browser.send_json({"type": "set", "name": name, "refusal": refusal})

    async def _on_reset(self, message: Json) -> None:
        """Take the preset in force anew, and so all values of it."""
        known = self._known("preset")
        if refusal := await self._link.services.set_parameter(
            parameter_from_json(known, known["value"])
        ):
            raise RequestError(refusal)
        text = f"the tracker's values are those of the preset {known['value']}"
        text += "; the node's own stay as they are"
        await self._browsers.broadcast(note("reset", text))

    @property
    def _is_for_one(self) -> bool:
        return not any(
            one["name"] == "max_targets" and one["value"] > 1 for one in self._parameters
        )

    def _known(self, name: Any, unless: str = "the tracker's parameters are not known yet") -> Json:
        """A parameter by its name, by default one that every tracker has."""
        for one in self._parameters:
            if one["name"] == name:
                return one
        raise RequestError(unless)

    async def _read_parameters(self) -> None:
        try:
            self._parameters = await self._link.services.parameters()
        except TrackerError:
            self._parameters_are_old = True
            await asyncio.sleep(_TICK)
        else:
            await self._browsers.broadcast({"type": "parameters", "parameters": self._parameters})
        finally:
            self._reading = None

    def _soon(self, action: Coroutine[Any, Any, None]) -> None:
        # The loop itself keeps no task from being collected.
        task = asyncio.ensure_future(action)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
