"""What all browsers share: the frames, the tracker's health, and what they ask of the tracker.

Everything here runs in the event loop of the web server.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Protocol

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.console.answers import Json, packed
from pf_tracker_ros.node.console.pairing import Pairing, Shown
from pf_tracker_ros.node.console.pick import Pick, Verdict
from pf_tracker_ros.node.console.pictures import picture_of
from pf_tracker_ros.node.console.recording import PickedTarget, Recording
from pf_tracker_ros.node.console.tracker_link import TrackerError, TrackerLink
from pf_tracker_ros.node.console.tuning import parameter_file, parameter_of

# How often is looked at what does not come by itself: silence, and frames without an answer.
_TICK = 0.1
# The diagnostics come once a second; a tracker that says nothing for longer has gone.
_SILENCE = 1.6
_MEETING_TICKS = 20
# A target that nothing has been heard of for so long waits for an image.
_VERDICT_PATIENCE = 3.0
_FAULT_SHOWN = 6.0
_FIRST_FRAME_INTERVAL = 1.0
# A frame is under way while the one before is being drawn.
_FRAMES_UNDER_WAY = 2
_LARGEST_COORDINATE = 1e6


class RequestError(ValueError):
    """A browser asked for what cannot be; the message says why."""


class Browser(Protocol):
    """One page that is open."""

    async def send_json(self, message: Json) -> None:
        """Send a message; one to a browser that has gone is lost."""

    async def send_bytes(self, message: bytes) -> None:
        """Send a frame."""


class Credit:
    """How many frames may still be sent to a browser before it has drawn one.

    So a slow link drops frames instead of queuing them.
    """

    def __init__(self) -> None:
        self._left = asyncio.Semaphore(_FRAMES_UNDER_WAY)
        self._taken = 0

    async def take(self) -> None:
        """Wait until a frame may be sent."""
        await self._left.acquire()
        self._taken += 1

    def give_back(self) -> None:
        """A frame has been drawn."""
        if self._taken:
            self._taken -= 1
            self._left.release()


class Hub:
    """Brings browsers and the tracker together.

    Args:
        link: To the tracker.
        recording: That is played to it, if one is.
    """

    def __init__(self, link: TrackerLink, recording: Recording | None = None) -> None:
        self._link = link
        self._recording = recording
        self._shown_recording: Json = {}
        self._show_first_at = float("-inf")
        self._picked: PickedTarget | None = None
        self._seeking = asyncio.Lock()
        self._pairing = Pairing()
        self._browsers: dict[Browser, Credit] = {}
        self._heated: set[Browser] = set()
        self._changed = asyncio.Condition()
        self._encoder = ThreadPoolExecutor(1, "encoder")
        self._encoded: tuple[int, asyncio.Future[bytes]] = (0, asyncio.Future())
        self._status: Json | None = None
        self._health: Json | None = None
        self._heard_at: float | None = None
        self._answered_at = float("-inf")
        self._fault, self._fault_at = "", float("-inf")
        self._shown_health: Json = {}
        self._pick: Pick | None = None
        self._picks = 0
        self._parameters: list[Json] = []
        self._reading: asyncio.Task[None] | None = None
        self._parameters_are_old = True
        self._tasks: set[asyncio.Task[None]] = set()
        self._requests: Mapping[str, Callable[[Json], Awaitable[None]]] = {
            "target": self._on_target,
            "click": self._on_click,
            "stop": self._on_stop,
            "enable": self._on_enable,
            "reset": self._on_reset,
            "play": self._on_play,
            "step": self._on_step,
            "seek": self._on_seek,
            "rate": self._on_rate,
            "save": self._on_save,
        }
        self._own_requests: Mapping[str, Callable[[Browser, Json], Awaitable[None]]] = {
            "set": self._on_set,
            "heat": self._on_heat,
        }
        if recording:
            self._watch()

    async def run(self) -> None:
        """Notice silence, until canceled."""
        while True:
            await self._look()
            await asyncio.sleep(_TICK)

    def close(self) -> None:
        """Encode no more."""
        self._encoder.shutdown(wait=False, cancel_futures=True)

    def parameter_file(self) -> str:
        """The preset and what differs from it, as a ROS parameter file."""
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
            self._fault, self._fault_at = content, now
        elif kind == "health":
            self._heard_at, self._health = now, content
            self._link.follow_images(str(content["values"].get("image_topic", "")))
            self._conclude(self._pick.judge_health(content, now) if self._pick else None)
        else:
            self._pairing.add_answer(stamp, kind, content, now)
        if kind == "status":
            self._heard_at = self._answered_at = now
            self._status = content
            self._conclude(self._pick.judge_status(content) if self._pick else None)
        self._soon(self._look())

    async def _look(self) -> None:
        """Tell the browsers what is new."""
        now = time.monotonic()
        if self._pairing.choose(now):
            async with self._changed:
                self._changed.notify_all()
        health = self._current_health(now)
        if health != self._shown_health:
            self._shown_health = health
            await self._tell_all(health)
        if self._recording:
            await self._show_recording(self._recording, now)
        if health["tracker"] != "heard":
            # It may come back with others.
            self._parameters_are_old = True
        elif self._parameters_are_old and self._browsers and not self._reading:
            self._parameters_are_old = False
            self._reading = asyncio.ensure_future(self._read_parameters())
        if self._pick and not self._recording:
            with contextlib.suppress(TrackerError):
                self._pick.send_again(self._answered_at, now)
        if self._pick and now - self._pick.sent_at > _VERDICT_PATIENCE:
            waiting = Verdict("waiting", "sent; the tracker answers with the next image")
            self._conclude(waiting, final=False)
            self._pick.sent_at = math.inf

    async def _show_recording(self, recording: Recording, now: float) -> None:
        state = self._recording_state
        if state != self._shown_recording:
            self._shown_recording = state
            await self._tell_all(state)
        # There has to be a picture to draw the target on; the first may go by before the console
        # is known to be a subscriber.
        if self._pairing.latest is None and recording.paused and now > self._show_first_at:
            self._show_first_at = now + _FIRST_FRAME_INTERVAL
            recording.seek(recording.frame)

    def _current_health(self, now: float) -> Json:
        """How the tracker is, in the words of its diagnostics."""
        name = self._link.name
        said = self._health or self._status
        if self._heard_at is None or said is None:
            text = (
                f"no tracker is heard as {name}; start it (ros2 run pf_tracker_ros tracker), with "
                "the ROS_DOMAIN_ID of the console"
            )
            return {"type": "health", "tracker": "absent", "level": "error", "text": text}
        if now - self._heard_at > _SILENCE:
            text = (
                f"{name} has fallen silent: it has ended, hangs, or cannot be reached; the console "
                "goes on with it as soon as it is back"
            )
            return {"type": "health", "tracker": "silent", "level": "error", "text": text}
        values, text, level = said["values"], str(said["message"]), said["level"]
        if now - self._fault_at < _FAULT_SHOWN:
            text, level = f"{text}; the console: {self._fault}", "error"
        if self._recording and self._recording.paused and text.startswith("no image for"):
            # No fault of anybody while the recording stands still.
            text, level = text.partition("; ")[2], "ok"
        return {
            "type": "health",
            "tracker": "heard",
            "level": level,
            "text": text,
            "state": values.get("state"),
            "confidence": values.get("confidence"),
            "image_topic": values.get("image_topic"),
            "image_reliability": values.get("image_reliability"),
            "preset": values.get("preset"),
            "input_rate": values.get("input_rate"),
        }

    # Browsers

    async def welcome(self, browser: Browser) -> None:
        """Show everything to a browser, until canceled."""
        credit = Credit()
        self._browsers[browser] = credit
        self._watch()
        try:
            await browser.send_json({"type": "welcome", "tracker": self._link.name})
            await browser.send_json(self._current_health(time.monotonic()))
            if self._recording:
                await browser.send_json(self._recording_state)
            await browser.send_json({"type": "parameters", "parameters": self._parameters})
            await self._show(browser, credit)
        finally:
            del self._browsers[browser]
            self._heated.discard(browser)
            self._watch()

    async def handle(self, browser: Browser, message: Any) -> None:
        """Do what a browser asks; what goes wrong is told to it alone."""
        kind = message.get("type") if isinstance(message, dict) else None
        if kind == "shown":
            if browser in self._browsers:
                self._browsers[browser].give_back()
            return
        try:
            if isinstance(kind, str) and kind in self._own_requests:
                await self._own_requests[kind](browser, message)
                return
            if not isinstance(kind, str) or kind not in self._requests:
                raise RequestError(f"there is no request {kind!r}")
            await self._requests[kind](message)
        except (RequestError, TrackerError) as error:
            await browser.send_json(
                {"type": "note", "about": kind, "ok": False, "text": str(error)}
            )

    async def _show(self, browser: Browser, credit: Credit) -> None:
        number = 0
        while True:
            async with self._changed:
                while self._newest_number <= number:
                    await self._changed.wait()
            await credit.take()
            shown = self._pairing.latest
            assert shown is not None
            number = shown.number
            await browser.send_bytes(await self._encode(shown))

    @property
    def _newest_number(self) -> int:
        return self._pairing.latest.number if self._pairing.latest else 0

    async def _encode(self, shown: Shown) -> bytes:
        """A frame as it is sent, made once for all browsers."""
        if self._encoded[0] != shown.number:
            loop = asyncio.get_running_loop()
            self._encoded = (shown.number, loop.run_in_executor(self._encoder, _encoded, shown))
        return await asyncio.shield(self._encoded[1])

    def _watch(self) -> None:
        # A recording's first frame comes once, perhaps before the first browser.
        watched = bool(self._browsers) or self._recording is not None
        self._link.watch(watched)
        self._link.watch_likelihood(bool(self._heated))
        wanted = {"particles": watched, "likelihood": bool(self._heated)}
        self._pairing.wanted = {part for part, is_wanted in wanted.items() if is_wanted}

    async def _tell_all(self, message: Json) -> None:
        await asyncio.gather(*(browser.send_json(message) for browser in list(self._browsers)))

    # Requests

    async def _on_target(self, message: Json) -> None:
        x, y, width, height = _numbers(message, "box", 4)
        await self._send_target((x, y, width, height), _stamp(message))

    async def _on_click(self, message: Json) -> None:
        x, y = _numbers(message, "point", 2)
        stamp = _stamp(message)
        if self._recording:
            # To be tried again, it has to be a box.
            size = next((p["value"] for p in self._parameters if p["name"] == "click_size"), None)
            if size is None:
                raise RequestError("the tracker's parameters are not known yet")
            await self._send_target((x - size / 2, y - size / 2, size, size), stamp)
            return
        await self._expect_verdict(partial(self._link.send_click, x, y, stamp))

    async def _send_target(self, box: Box, stamp: int) -> None:
        """Send a target; a recording goes on from the frame that it was drawn on."""
        frame = self._recording.index_of(stamp) if self._recording else None
        if frame is None:
            await self._expect_verdict(partial(self._link.send_target, box, stamp))
            return
        self._picked = PickedTarget(box, stamp, frame)
        await self._go_to(frame)

    async def _on_play(self, message: Json) -> None:
        playing = message.get("playing")
        if not isinstance(playing, bool):
            raise RequestError("'playing' has to be true or false")
        self._played.paused = not playing

    async def _on_step(self, message: Json) -> None:
        self._played.paused = True
        self._played.step()

    async def _on_seek(self, message: Json) -> None:
        frame, last = message.get("frame"), self._played.last_frame
        if not isinstance(frame, int) or isinstance(frame, bool) or frame < 0:
            raise RequestError("'frame' has to be a whole number from 0 on")
        await self._go_to(frame if last is None else min(frame, last))

    async def _on_rate(self, message: Json) -> None:
        (rate,) = _numbers({"rate": [message.get("rate")]}, "rate", 1)
        if refusal := self._played.set_rate(rate):
            raise RequestError(refusal)

    async def _on_save(self, message: Json) -> None:
        if self._picked is None:
            raise RequestError("there is no target to save; draw one first")
        try:
            path = self._played.save(self._picked)
        except OSError as error:
            raise RequestError(f"the target cannot be saved: {error}") from error
        text = f"saved as {path.name}, beside the recording"
        await self._tell_all({"type": "note", "about": "save", "ok": True, "text": text})

    @property
    def _played(self) -> Recording:
        if self._recording is None:
            raise RequestError("there is no recording; start the console with one")
        return self._recording

    @property
    def _recording_state(self) -> Json:
        return {"type": "recording", "saves": self._picked is not None, **self._played.state}

    async def _go_to(self, frame: int) -> None:
        """Play a frame of the recording so that the boxes are those of a run in lockstep.

        With a target, that begins on the frame that it was drawn on.
        """
        played, loop = self._played, asyncio.get_running_loop()
        async with self._seeking:
            was_paused = played.paused
            played.paused = True
            try:
                if not await loop.run_in_executor(None, played.settle):
                    raise RequestError("the tracker does not answer the recording's last frame")
                await self._link.stop()
                target, first = self._picked, frame
                if target:
                    send = partial(self._link.send_target, target.box, target.stamp)
                    first = min(frame, target.frame)
                    if first == target.frame:
                        await self._expect_verdict(send)
                    else:
                        send()
                    while not await loop.run_in_executor(None, self._link.await_target):
                        send()
                played.seek(first)
                if frame > first:
                    played.step(frame - first)
                await loop.run_in_executor(None, played.settle)
            finally:
                played.paused = was_paused

    async def _on_stop(self, message: Json) -> None:
        self._picked = None
        text = await self._link.stop()
        await self._tell_all({"type": "note", "about": "stop", "ok": True, "text": text})

    async def _on_enable(self, message: Json) -> None:
        enabled = message.get("enabled")
        if not isinstance(enabled, bool):
            raise RequestError("'enabled' has to be true or false")
        text = await self._link.enable(enabled)
        await self._tell_all({"type": "note", "about": "enable", "ok": True, "text": text})

    async def _on_set(self, browser: Browser, message: Json) -> None:
        """Set a parameter; a refusal is for the field that it was given in."""
        name = message.get("name")
        known = next((one for one in self._parameters if one["name"] == name), None)
        if known is None:
            raise RequestError(f"there is no parameter {name!r}")
        try:
            refusal = await self._link.set_parameter(parameter_of(known, message.get("value")))
        except (ValueError, TrackerError) as error:
            refusal = str(error)
        await browser.send_json({"type": "set", "name": name, "refusal": refusal})

    async def _on_heat(self, browser: Browser, message: Json) -> None:
        """Show the likelihood around the target, or hide it."""
        if message.get("shown") is True and browser in self._browsers:
            self._heated.add(browser)
        else:
            self._heated.discard(browser)
        self._watch()

    async def _on_reset(self, message: Json) -> None:
        """Take the preset in force anew, and so all values of it."""
        known = next((one for one in self._parameters if one["name"] == "preset"), None)
        if known is None:
            raise RequestError("the tracker's parameters are not known yet")
        if refusal := await self._link.set_parameter(parameter_of(known, known["value"])):
            raise RequestError(refusal)
        text = f"every value is that of the preset {known['value']}"
        await self._tell_all({"type": "note", "about": "reset", "ok": True, "text": text})

    async def _read_parameters(self) -> None:
        try:
            self._parameters = await self._link.parameters()
        except TrackerError:
            self._parameters_are_old = True
            await asyncio.sleep(_TICK)
        else:
            await self._tell_all({"type": "parameters", "parameters": self._parameters})
        finally:
            self._reading = None

    async def _expect_verdict(self, send: Callable[[], None]) -> None:
        """Send a target, and tell what becomes of it."""
        # A tracker that has just been found may not be known to take any yet.
        for _ in range(_MEETING_TICKS):
            if self._link.takes_targets:
                break
            await asyncio.sleep(_TICK)
        send()
        self._picks += 1
        self._pick = Pick(self._picks, time.monotonic(), send)

    def _conclude(self, verdict: Verdict | None, *, final: bool = True) -> None:
        if verdict is None or self._pick is None:
            return
        if final:
            self._pick = None
            if verdict.outcome == "refused":
                self._picked = None
        told = {"type": "verdict", "outcome": verdict.outcome, "text": verdict.text}
        self._soon(self._tell_all(told))

    def _soon(self, action: Coroutine[Any, Any, None]) -> None:
        # The loop itself keeps no task from being collected.
        task = asyncio.ensure_future(action)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _encoded(shown: Shown) -> bytes:
    picture = picture_of(shown.image)
    header = {
        "stamp": str(shown.stamp),
        "width": picture.width,
        "height": picture.height,
        "error": picture.error,
        **shown.answer,
    }
    return packed(header, picture.jpeg)


def _numbers(message: Json, name: str, count: int) -> list[float]:
    values = message.get(name)
    if not isinstance(values, list) or len(values) != count:
        raise RequestError(f"'{name}' has to be a list of {count} numbers")
    if any(isinstance(one, bool) or not isinstance(one, int | float) for one in values):
        raise RequestError(f"'{name}' has to be a list of {count} numbers")
    if not all(abs(one) <= _LARGEST_COORDINATE for one in values):
        raise RequestError(f"'{name}' has numbers beyond {_LARGEST_COORDINATE:g}")
    return [float(one) for one in values]


def _stamp(message: Json) -> int:
    """A stamp in nanoseconds, as text because JavaScript's numbers do not hold it."""
    text = message.get("stamp")
    if not isinstance(text, str) or not text.isascii() or not text.isdigit() or len(text) > 19:
        raise RequestError("'stamp' has to be a text of digits, nanoseconds")
    return int(text)
