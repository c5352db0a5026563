"""Images and what the tracker said of them, brought together by their stamps."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from pf_tracker_ros.node.console.json_conversions import Json

# Images that may wait for an answer: that of a fast camera comes after many others have.
_MOST_IMAGES = 32
# Fewer of large ones, octets, but so many in any case.
_MOST_OCTETS = 2**26
_FEWEST = 8
_MOST_ANSWERS = 32
# An image that nobody has answered for so long, in seconds, is shown as it is; for longer where the
# answers take long, too.
_PATIENCE = 0.25
_TIMES_USUAL = 2.0
_FORGETTING = 0.9
# Parts of one answer come together: one that came so much before its status, in seconds, is of
# another answer to the same stamp.
_TOGETHER = 0.2
# A tracker that has been silent for so long is not waited for.
_SILENCE = 1.0


@dataclass(frozen=True)
class DisplayFrame:
    """A frame for the page.

    Attributes:
        number: Counts the frames that were shown, from 1.
        stamp: Of its header, nanoseconds.
        image: The message.
        parts: What the tracker said of it, and of an earlier frame of the same stamp: `status`,
            `boxes`, `particles` and `likelihood`, as far as it did.
    """

    number: int
    stamp: int
    image: Any
    parts: Json

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the image, pixels; None of one that does not tell."""
        width, height = getattr(self.image, "width", 0), getattr(self.image, "height", 0)
        return (width, height) if width and height else None

    @property
    def answer(self) -> Json:
        """The parts that belong to the status."""
        status = self.parts.get("status")
        if status and status["targets"]:
            return self.parts
        return {"status": status} if status else {}


@dataclass
class _Answer:
    """The parts, and when each of them came."""

    parts: Json = field(default_factory=dict)
    times: dict[str, float] = field(default_factory=dict)

    def copy(self) -> _Answer:
        return _Answer(dict(self.parts), dict(self.times))

    def is_complete(self, wanted: Collection[str]) -> bool:
        status = self.parts.get("status")
        if status is None:
            return False
        since = self.times["status"] - _TOGETHER
        own = {part for part, time in self.times.items() if time >= since}
        needed = {"boxes", *wanted} if status["targets"] else set()
        if not status["selected"]:
            needed.discard("likelihood")
        return own >= needed


class FrameSynchronizer:
    """Chooses the frame to show: the newest one that the tracker has answered.

    So the boxes always belong to the picture. Images that get no answer are shown without one, late
    where the tracker is there, at once where it is not. What is older than a frame that has been
    shown is not shown, unless time went back with the images.

    Attributes:
        latest: The frame to show; None before the first.
        required_parts: Parts of the answer that are waited for besides status and boxes.
    """

    def __init__(self) -> None:
        self.latest: DisplayFrame | None = None
        self.required_parts: set[str] = set()
        # Those that may still be shown, as they came, each with its time.
        self._images: OrderedDict[int, tuple[Any, float]] = OrderedDict()
        self._answers: OrderedDict[int, _Answer] = OrderedDict()
        # The answer to the latest.
        self._known = _Answer()
        # How long an answer takes, seconds.
        self._usual = 0.0
        self._answered_at = float("-inf")

    def add_image(self, stamp: int, image: Any, now: float) -> None:
        """Take an image.

        Args:
            stamp: Of its header, nanoseconds.
            image: The message.
            now: When it came, seconds by any clock that is always the same.
        """
        self._images.pop(stamp, None)
        self._images[stamp] = image, now
        while self._are_too_many():
            self._images.popitem(last=False)

    def _are_too_many(self) -> bool:
        octets = sum(len(getattr(image, "data", b"")) for image, _ in self._images.values())
        most = _FEWEST if octets > _MOST_OCTETS else _MOST_IMAGES
        return len(self._images) > most

    def add_result(self, stamp: int, part: str, content: Any, now: float) -> None:
        """Take a part of an answer.

        Args:
            stamp: Of the image that it is about.
            part: `status`, `boxes`, `particles` or `likelihood`.
            content: As in `DisplayFrame.answer`.
            now: As for `add_image`.
        """
        if self.latest and self._is_latest(stamp) and stamp not in self._images:
            # A part that is late, or another answer, as where a frame is played again. What has
            # come since then is newer.
            self._images[stamp] = self.latest.image, now
            self._images.move_to_end(stamp, last=False)
            self._answers[stamp] = self._known.copy()
        answer = self._answers.setdefault(stamp, _Answer())
        answer.parts[part], answer.times[part] = content, now
        if part == "status":
            self._answered_at = now
        while len(self._answers) > _MOST_ANSWERS:
            self._answers.popitem(last=False)

    def choose(self, now: float) -> bool:
        """Bring `latest` up to date, and tell whether it is another frame than before."""
        silent = now - self._answered_at > _SILENCE
        for stamp, (image, arrival) in reversed(self._images.items()):
            answer = self._answers.get(stamp) or self._known_of(stamp)
            complete = answer.is_complete(self.required_parts)
            if complete:
                self._usual = max(now - arrival, _FORGETTING * self._usual)
            patience = max(_PATIENCE, _TIMES_USUAL * self._usual)
            if complete or silent or now - arrival > patience:
                number = self.latest.number + 1 if self.latest else 1
                self._known = answer.copy()
                self.latest = DisplayFrame(number, stamp, image, self._known.parts)
                older = None
                while older != stamp:
                    older, _ = self._images.popitem(last=False)
                    # Where stamps repeat, as in a loop, this is no answer to the next one.
                    self._answers.pop(older, None)
                return True
        return False

    def _known_of(self, stamp: int) -> _Answer:
        """What is known of an image that nothing has been said of since it came.

        All there was to say may have come before it, with the image of the same stamp before.
        """
        return self._known if self._is_latest(stamp) else _Answer()

    def _is_latest(self, stamp: int) -> bool:
        return self.latest is not None and stamp == self.latest.stamp
