"""Plays the recording for the page, so that targets can be drawn, tried and changed.

A seek restarts the tracker, and a single target drawn on the page is a seek to its frame:

1. The recording pauses, and the tracker stops its targets.
2. The recording goes to the first target's frame, or to the sought frame if that is earlier.
3. It steps to the sought frame. Each target is sent just before the frame that it was drawn on.

So the boxes are those of a run in lockstep with the same targets.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.node.console.json_conversions import Json, note
from pf_tracker_ros.node.console.played_recording import PlayedRecording
from pf_tracker_ros.node.console.requests import RequestError, boolean_of, integer_of, number_of
from pf_tracker_ros.node.console.target_requester import TargetRequester
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.tracker_services import TrackerError
from pf_tracker_ros.node.replay.playback import Playback
from pf_tracker_ros.recordings import RecordingError, Target
from pf_tracker_ros.stamps import NANOSECONDS

_FIRST_FRAME_INTERVAL = 1.0
# Seconds for the discovery of an opened recording; what is missing later is a problem.
_DISCOVERY = 5.0
# The tracker refuses targets that are a minute ahead of its last image.
_MAX_AHEAD = 30 * NANOSECONDS
# Of two seconds each.
_ATTEMPTS = 3

REQUESTS = ("open", "play", "step", "seek", "rate", "save", "load")
"""Requests about the recording."""


class Player:
    """Carries out the requests of browsers about the recording.

    Attributes:
        targets: The drawn targets, in the order of drawing.

    Args:
        recording: The recording.
        link: Topics and services of the tracker.
        requester: Sends targets.
        broadcast: Sends a message to all browsers.
        is_single_target: Returns whether `max_targets` is 1.
    """

    def __init__(
        self,
        recording: PlayedRecording,
        link: TrackerLink,
        requester: TargetRequester,
        broadcast: Callable[[Json], Awaitable[None]],
        is_single_target: Callable[[], bool],
    ) -> None:
        self.targets: list[Target] = []
        self._recording = recording
        self._link = link
        self._requester = requester
        self._broadcast = broadcast
        self._is_single_target = is_single_target
        self._last_state: Json = {}
        self._show_first_after = float("-inf")
        # Until the page has a picture of the recording that was asked for.
        self._is_opening = False
        self._opened_at = float("-inf")
        self._seeking = asyncio.Lock()
        self._repeating: asyncio.Future[None] | None = None
        # Requests during a seek, which is paused; carried out after it.
        self._plays_after = False
        self._steps_after = 0
        # Targets still to be sent with their frames.
        self._due: list[Target] = []
        recording.before_frame = self._send_due

    @property
    def _playback(self) -> Playback:
        return self._recording.replay.playback

    async def handle(self, name: str, message: Json) -> None:
        """Carry out one of `REQUESTS`, by the method of its name.

        Raises:
            RequestError: The request is invalid or failed.
        """
        await getattr(self, f"_on_{name}")(message)

    @property
    def state(self) -> Json:
        """The `recording` message for the page."""
        return {
            "type": "recording",
            "can_save": bool(self.targets),
            "problem": ""
            if self._is_opening
            else self._recording.wait_reason(self._link.image_topic),
            **self._recording.state,
            "playing": self._is_playing,
            "opening": self._is_opening,
        }

    @property
    def _is_playing(self) -> bool:
        """Whether it plays, or will after the present seek."""
        return self._plays_after if self._seeking.locked() else not self._playback.paused

    @property
    def recording_paused(self) -> bool:
        """Whether the recording is paused or being opened, so that no images come."""
        is_paused = self._playback.paused and not self._recording.wait_reason("")
        return self._is_opening or is_paused

    def index_of(self, stamp: int) -> int | None:
        """Index of a frame by its stamp, nanoseconds; None if it is not of the recording."""
        return self._recording.replay.index_of(stamp)

    def clear_targets(self) -> str:
        """Remove all targets.

        Returns:
            A sentence if the tracker had not received them yet, else empty.
        """
        frames, self.targets = [_frame_of(target) for target in self.targets], []
        if not frames or self._recording.frame >= min(frames):
            return ""
        return f"the target of frame {min(frames)} is removed; waiting for a target"

    def remove_last_target(self) -> None:
        """Remove the last target, which was refused."""
        self.targets = self.targets[:-1]

    async def poll(self, now: float, shown: int | None) -> None:
        """Broadcast a changed state, and show the first frame.

        Args:
            now: Seconds by a monotonic clock.
            shown: Stamp of the page's picture, nanoseconds; None without one.
        """
        has_picture = shown is not None and self._recording.replay.index_of(shown) is not None
        is_opened = has_picture or now - self._opened_at > _DISCOVERY
        if is_opened and not self._seeking.locked():
            self._is_opening = False
        state = self.state
        if state != self._last_state:
            self._last_state = state
            await self._broadcast(state)
        # The first frame may be lost before the console is discovered as a subscriber.
        is_idle = self._playback.paused and not self._seeking.locked()
        if not has_picture and is_idle and now > self._show_first_after:
            self._show_first_after = now + _FIRST_FRAME_INTERVAL
            if self._recording.replay.position < 0:
                self._playback.seek(0)
            else:
                self._repeating = asyncio.ensure_future(self._repeat_frame())

    async def _repeat_frame(self) -> None:
        """Show the frame again; after a stop it is no duplicate for the tracker."""
        with contextlib.suppress(RequestError, TrackerError):
            await self._go_to(self._recording.frame)

    async def start_from_target(
        self, box: Box, stamp: int, image_size: tuple[int, int] | None
    ) -> bool:
        """Restart the playback at the frame of a new target.

        With several targets the others continue: a paused recording shows its present frame once
        more, and the target begins on it.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame, nanoseconds.
            image_size: (width, height) of its image, None where that is unknown.

        Returns:
            False if the caller has to send the target itself.
        """
        frame = self._recording.replay.index_of(stamp)
        if frame is None:
            return False
        target = Target(box, stamp, frame, image_size)
        if self._is_single_target():
            self.targets = [target]
            await self._go_to(frame)
            return True
        self.targets.append(target)
        return await self._start_on_shown_frame(box, stamp, frame)

    async def _start_on_shown_frame(self, box: Box, stamp: int, frame: int) -> bool:
        """Replay a frame with a target on it; False unless the recording is paused there."""
        is_shown = frame == self._recording.frame and self._playback.paused
        if not is_shown or self._seeking.locked():
            return False
        async with self._paused(plays=False):
            await self._requester.send(partial(self._link.send_target, box, stamp))
            await asyncio.to_thread(self._link.wait_for_target_ack)
            self._playback.seek(frame)
            await asyncio.to_thread(self._recording.wait_until_idle)
        return True

    @contextlib.asynccontextmanager
    async def _paused(self, *, plays: bool | None) -> AsyncIterator[None]:
        """Pause the recording; requests during this time are carried out afterwards.

        Args:
            plays: Whether it plays afterwards, unless requested otherwise; None as at present.
        """
        async with self._seeking:
            self._plays_after = not self._playback.paused if plays is None else plays
            self._steps_after = 0
            self._playback.paused = True
            try:
                yield
            finally:
                self._playback.paused = not self._plays_after
                if self._steps_after:
                    self._playback.step(self._steps_after)

    async def _on_open(self, message: Json) -> None:
        """Play another recording of the list; the targets are stopped."""
        index = integer_of(message, "index")
        if index >= len(self._recording.listed):
            raise RequestError(f"there is no recording {index}")
        async with self._paused(plays=False):
            self._is_opening = True
            # Without a tracker there is nothing to stop.
            with contextlib.suppress(TrackerError):
                await self._link.services.stop()
            try:
                await asyncio.to_thread(self._recording.open, index)
            except RecordingError as error:
                raise RequestError(str(error)) from error
            finally:
                self._opened_at = time.monotonic()
            self.targets, self._due = [], []
            self._show_first_after = float("-inf")

    async def _on_play(self, message: Json) -> None:
        playing = boolean_of(message, "playing")
        if self._seeking.locked():
            self._plays_after, self._steps_after = playing, 0
        elif playing and self._playback.is_at_end:
            await self._go_to(0, plays=True)
        else:
            self._playback.paused = not playing
            if not playing:
                self._playback.drop_steps()

    async def _on_step(self, message: Json) -> None:
        if self._seeking.locked():
            self._plays_after = False
            self._steps_after += 1
        else:
            self._playback.paused = True
            self._playback.step()

    async def _on_seek(self, message: Json) -> None:
        frame, last = integer_of(message, "frame"), self._recording.last_frame
        await self._go_to(frame if last is None else min(frame, last))

    async def _on_rate(self, message: Json) -> None:
        if refusal := self._recording.set_rate(number_of(message, "rate")):
            raise RequestError(refusal)

    async def _on_save(self, message: Json) -> None:
        if not self.targets:
            raise RequestError("there is no target to save; draw one first")
        try:
            path = self._recording.save(self.targets)
        except OSError as error:
            raise RequestError(f"the target cannot be saved: {error}") from error
        await self._broadcast(note("save", f"saved as {path.name} beside the recording"))

    async def _on_load(self, message: Json) -> None:
        """Load the targets of the recording's sidecar file, and go to the frame of the first."""
        try:
            self.targets = await asyncio.to_thread(self._recording.load)
        except (RecordingError, FootageError) as error:
            raise RequestError(str(error)) from error
        await self._go_to(min(map(_frame_of, self.targets)))

    async def _approach(self, target: Target) -> None:
        """Send the frame before a target's, if the tracker would refuse the target as too early."""
        if target.frame and target.stamp - self._recording.replay.stamp > _MAX_AHEAD:
            self._playback.seek(target.frame - 1)
            await asyncio.to_thread(self._recording.wait_until_idle)

    def _send_due(self, index: int) -> None:
        """Send the targets of a frame, before the frame is published.

        Called in the thread of the playback.
        """
        due = [target for target in self._due if target.frame == index]
        self._due = [target for target in self._due if target.frame != index]
        for target in due:
            # A target may have been stopped or refused meanwhile.
            if target in self.targets and not self._send_target(target):
                return

    def _send_target(self, target: Target) -> bool:
        """Send a target until the tracker acknowledges it; False if there is no tracker."""
        assert target.box is not None
        for _ in range(_ATTEMPTS):
            try:
                self._link.send_target(target.box, target.stamp)
            except TrackerError:
                # The page shows that there is no tracker.
                return False
            if self._link.wait_for_target_ack():
                break
        return True

    async def _go_to(self, frame: int, *, plays: bool | None = None) -> None:
        """Go to a frame; its boxes are those of a run in lockstep from the first target on.

        Args:
            frame: Index, counted from 0.
            plays: Whether it plays on from there; None as at present.
        """
        async with self._paused(plays=plays):
            if not await asyncio.to_thread(self._recording.wait_until_idle):
                raise RequestError("the tracker has sent no status for the last frame")
            await self._link.services.stop()
            first, self._due = frame, list(self.targets)
            if self.targets:
                earliest = min(self.targets, key=_frame_of)
                begins = _frame_of(earliest)
                first = min(frame, begins)
                if frame < begins:
                    text = f"the target begins at frame {begins}, where it was drawn"
                    await self._broadcast(note("seek", text))
                if first == begins:
                    await self._approach(earliest)
                    assert earliest.box is not None
                    send = partial(self._link.send_target, earliest.box, earliest.stamp)
                    await self._requester.send(send, is_sent_later=True)
            self._playback.seek(first)
            if frame > first:
                self._playback.step(frame - first)
            await asyncio.to_thread(self._recording.wait_until_idle)


def _frame_of(target: Target) -> int:
    """The frame that a target was drawn on."""
    return target.frame or 0
