"""Plays the recording for the page, so that a target can be tried again and again."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.node.console.json_conversions import Json, note
from pf_tracker_ros.node.console.played_recording import PlayedRecording
from pf_tracker_ros.node.console.requests import RequestError, boolean_of, integer_of, number_of
from pf_tracker_ros.node.console.target_requester import TargetRequester
from pf_tracker_ros.node.console.tracker_link import TrackerLink
from pf_tracker_ros.node.console.tracker_services import TrackerError
from pf_tracker_ros.recordings import RecordingError, Target
from pf_tracker_ros.stamps import NANOSECONDS

_FIRST_FRAME_INTERVAL = 1.0
# A tracker takes no target of a frame that is a minute ahead of its time.
_NEAR = 30 * NANOSECONDS
# Each waits for two seconds.
_ATTEMPTS = 3

REQUESTS = ("play", "step", "seek", "rate", "save", "load")
"""What can be asked of a recording."""


class Player:
    """Does what browsers ask of the recording.

    Attributes:
        targets: The targets that are tried, in the order in which they were drawn.

    Args:
        recording: That is played.
        link: To the tracker.
        picker: Sends the target.
        tell: Tells all browsers something.
        is_single_target: Whether there may be one target alone.
    """

    def __init__(
        self,
        recording: PlayedRecording,
        link: TrackerLink,
        picker: TargetRequester,
        tell: Callable[[Json], Awaitable[None]],
        is_single_target: Callable[[], bool],
    ) -> None:
        self.targets: list[Target] = []
        self._recording = recording
        self._link = link
        self._picker = picker
        self._tell = tell
        self._is_for_one = is_single_target
        self._told: Json = {}
        self._show_first_at = float("-inf")
        self._seeking = asyncio.Lock()
        # What is wanted once a frame that is sought has been found; until then it stands still.
        self._plays_after = False
        self._steps_after = 0
        # The targets to be sent with their frames.
        self._due: list[Target] = []
        self._playback = recording.replay.playback
        recording.replay.before_frame = self._send_due

    async def handle(self, name: str, message: Json) -> None:
        """Do one of `REQUESTS`, by the method of its name.

        Raises:
            RequestError: It cannot be done.
        """
        await getattr(self, f"_on_{name}")(message)

    @property
    def state(self) -> Json:
        """What the page shows of the recording."""
        return {
            "type": "recording",
            "can_save": bool(self.targets),
            "problem": self._recording.wait_reason(self._link.image_topic),
            **self._recording.state,
            "playing": self._plays,
        }

    @property
    def _plays(self) -> bool:
        """Whether it plays, or will as soon as the frame is found that is sought."""
        return self._plays_after if self._seeking.locked() else not self._playback.paused

    @property
    def recording_paused(self) -> bool:
        """Whether no images are to be expected."""
        return self._playback.paused and not self._recording.wait_reason("")

    def clear_targets(self) -> str:
        """Try no target any more.

        Returns:
            What was forgotten where the tracker does not know of it yet; empty where it does.
        """
        frames, self.targets = [_frame_of(target) for target in self.targets], []
        if not frames or self._recording.frame >= min(frames):
            return ""
        return f"the target of frame {min(frames)} is forgotten; waiting for a target"

    def remove_last_target(self) -> None:
        """Try the target no more that was drawn last: it was refused."""
        self.targets = self.targets[:-1]

    async def poll(self, now: float, *, has_picture: bool) -> None:
        """Tell the browsers what is new.

        Args:
            now: Seconds by a clock that never jumps.
            has_picture: Whether there is one to draw a target on.
        """
        state = self.state
        if state != self._told:
            self._told = state
            await self._tell(state)
        # The first may go by before the console is known to be a subscriber.
        is_idle = self._playback.paused and not self._seeking.locked()
        if not has_picture and is_idle and now > self._show_first_at:
            self._show_first_at = now + _FIRST_FRAME_INTERVAL
            self._playback.seek(self._recording.frame)

    async def start_from_target(
        self, box: Box, stamp: int, image_size: tuple[int, int] | None
    ) -> bool:
        """Play on from the frame that a target was drawn on.

        Where there may be several, those before it go on: where the recording stands still, its
        frame is shown once more, and the target begins on it.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame, nanoseconds.
            image_size: (width, height) of its image, None where that is unknown.

        Returns:
            Whether it does.
        """
        frame = self._recording.replay.index_of(stamp)
        if frame is None:
            return False
        target = Target(box, stamp, frame, image_size)
        if self._is_for_one():
            self.targets = [target]
            await self._go_to(frame)
            return True
        self.targets.append(target)
        return await self._begin_on_the_same_frame(box, stamp, frame)

    async def _begin_on_the_same_frame(self, box: Box, stamp: int, frame: int) -> bool:
        """Show a frame once more, where it stands still there, with a target for it."""
        is_shown = frame == self._recording.frame and self._playback.paused
        if not is_shown or self._seeking.locked():
            return False
        async with self._held(plays=False):
            await self._picker.send(partial(self._link.send_target, box, stamp))
            await asyncio.to_thread(self._link.wait_for_target_ack)
            self._playback.seek(frame)
            await asyncio.to_thread(self._recording.wait_until_idle)
        return True

    @asynccontextmanager
    async def _held(self, *, plays: bool | None) -> AsyncIterator[None]:
        """The recording stands still; what is asked of it meanwhile is done afterwards.

        Args:
            plays: Whether it plays then, unless something else is asked; None if it does so now.
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
        await self._tell(note("save", f"saved as {path.name}, beside the recording"))

    async def _on_load(self, message: Json) -> None:
        """Take the targets of the file beside the recording, and go to the frame of the first."""
        try:
            self.targets = await asyncio.to_thread(self._recording.load)
        except (RecordingError, FootageError) as error:
            raise RequestError(str(error)) from error
        await self._go_to(min(map(_frame_of, self.targets)))

    async def _approach(self, target: Target) -> None:
        """Bring the tracker's time near the frame of a target, if it is far before that."""
        if target.frame and target.stamp - self._recording.replay.stamp > _NEAR:
            self._playback.seek(target.frame - 1)
            await asyncio.to_thread(self._recording.wait_until_idle)

    def _send_due(self, index: int) -> None:
        """Send the targets with the frame that they were drawn on, before that goes out.

        Called in another thread, which plays the frame after it.
        """
        due = [target for target in self._due if target.frame == index]
        self._due = [target for target in self._due if target.frame != index]
        for target in due:
            # One that was stopped or refused meanwhile is due no more.
            if target in self.targets and not self._sends(target):
                return

    def _sends(self, target: Target) -> bool:
        """Send a target until the tracker has it; False where there is no tracker."""
        assert target.box is not None
        for _ in range(_ATTEMPTS):
            try:
                self._link.send_target(target.box, target.stamp)
            except TrackerError:
                # The page tells of a tracker that is not there.
                return False
            if self._link.wait_for_target_ack():
                break
        return True

    async def _go_to(self, frame: int, *, plays: bool | None = None) -> None:
        """Play a frame of the recording so that the boxes are those of a run in lockstep.

        The targets that are tried begin on the frames that they were drawn on.

        Args:
            frame: Its index, counted from 0.
            plays: Whether it plays on from there; None if it does so now.
        """
        async with self._held(plays=plays):
            if not await asyncio.to_thread(self._recording.wait_until_idle):
                raise RequestError("the tracker does not answer the recording's last frame")
            await self._link.services.stop()
            first, self._due = frame, list(self.targets)
            if self.targets:
                earliest = min(self.targets, key=_frame_of)
                begins = _frame_of(earliest)
                first = min(frame, begins)
                if frame < begins:
                    text = f"the target begins at frame {begins}, where it was drawn"
                    await self._tell(note("seek", text))
                if first == begins:
                    await self._approach(earliest)
                    assert earliest.box is not None
                    send = partial(self._link.send_target, earliest.box, earliest.stamp)
                    await self._picker.send(send, is_sent_later=True)
            self._playback.seek(first)
            if frame > first:
                self._playback.step(frame - first)
            await asyncio.to_thread(self._recording.wait_until_idle)


def _frame_of(target: Target) -> int:
    """The frame that a target was drawn on."""
    return target.frame or 0
