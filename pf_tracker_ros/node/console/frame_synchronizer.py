"""Matches images with the tracker's results by their stamps."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from pf_tracker_ros.node.console.json_conversions import Json

# Images that may wait for a result: with a fast camera many come before it.
_MAX_IMAGES = 32
# Above so many bytes in total, only so many images wait.
_MAX_BYTES = 2**26
_MAX_LARGE_IMAGES = 8
_MAX_RESULTS = 32
# An image is shown without results after so long, in seconds, or after this multiple of the
# tracker's latency. That is a maximum which decays by this factor with each result. One with a part
# of its results waits as long from its status on.
_TIMEOUT = 0.25
_LATENCY_FACTOR = 2.0
_LATENCY_DECAY = 0.9
# Parts of one result come together: one that is older than its status by more than this, in
# seconds, belongs to an earlier result of the same stamp.
_TOGETHER = 0.2
# Images do not wait for a tracker that has been silent for so long, in seconds.
_SILENCE = 1.0


@dataclass(frozen=True)
class DisplayFrame:
    """A frame for the page.

    Attributes:
        number: Counts the displayed frames, from 1.
        stamp: Of its header, nanoseconds.
        image: The message.
        parts: The tracker's results for this stamp, as far as received: `status`, `boxes`,
            `particles` and `likelihood`. Some may be of an earlier frame with the same stamp.
    """

    number: int
    stamp: int
    image: Any
    parts: Json

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the image, pixels; None if the message has no size."""
        width, height = getattr(self.image, "width", 0), getattr(self.image, "height", 0)
        return (width, height) if width and height else None

    @property
    def results(self) -> Json:
        """The parts that belong to the status."""
        status = self.parts.get("status")
        if status and status["targets"]:
            return self.parts
        return {"status": status} if status else {}


@dataclass
class _Results:
    """The parts of a result, and the arrival time of each."""

    parts: Json = field(default_factory=dict)
    times: dict[str, float] = field(default_factory=dict)

    def copy(self) -> _Results:
        return _Results(dict(self.parts), dict(self.times))

    def is_complete(self, required: Collection[str]) -> bool:
        status = self.parts.get("status")
        if status is None:
            return False
        since = self.times["status"] - _TOGETHER
        own = {part for part, time in self.times.items() if time >= since}
        needed = {"boxes", *required} if status["targets"] else set()
        if not status["selected"]:
            needed.discard("likelihood")
        return own >= needed


class FrameSynchronizer:
    """Chooses the frame to show: the newest image with complete results.

    So the boxes always belong to the picture. An image without results is shown after a timeout,
    or at once while there is no tracker. An image older than the displayed one is dropped, unless
    the stamps of the images went back.

    Attributes:
        latest: The frame to show; None before the first.
        required_parts: Parts that a result needs besides status and boxes.

    Args:
        status_timeout: Seconds in which an image of a recording in lockstep gets its status, after
            the recording's first status; None for a camera, of which a tracker may drop images.
    """

    def __init__(self, status_timeout: float | None = None) -> None:
        self.latest: DisplayFrame | None = None
        self.required_parts: set[str] = set()
        # Candidates in the order of arrival, each with its arrival time.
        self._images: OrderedDict[int, tuple[Any, float]] = OrderedDict()
        self._results: OrderedDict[int, _Results] = OrderedDict()
        self._latest_results = _Results()
        self._number = 0
        # Of the tracker, seconds.
        self._latency = 0.0
        self._last_status_at: float | None = None
        self._status_timeout = status_timeout

    def clear(self) -> None:
        """Discard all images and results, before those of another recording."""
        self.latest, self._latest_results = None, _Results()
        self._last_status_at = None
        self._images.clear()
        self._results.clear()

    def add_image(self, stamp: int, image: Any, now: float) -> None:
        """Add an image.

        Args:
            stamp: Of its header, nanoseconds.
            image: The message.
            now: Time of arrival, seconds by a monotonic clock.
        """
        # One that is sent again has waited since it came first.
        _, arrival = self._images.pop(stamp, (None, now))
        self._images[stamp] = image, arrival
        while self._are_too_many():
            self._images.popitem(last=False)

    def _are_too_many(self, added: int = 0) -> bool:
        """Whether the oldest image is dropped, or is once so many are added."""
        sizes = [len(getattr(image, "data", b"")) for image, _ in self._images.values()]
        count = len(sizes) + added
        is_large = sum(sizes) * count > _MAX_BYTES * len(sizes)
        return count > (_MAX_LARGE_IMAGES if is_large else _MAX_IMAGES)

    def add_result(self, stamp: int, part: str, content: Any, now: float) -> None:
        """Add a part of a result.

        Args:
            stamp: Of the image.
            part: `status`, `boxes`, `particles` or `likelihood`.
            content: As in `DisplayFrame.results`.
            now: As for `add_image`.
        """
        if self.latest and self._is_latest(stamp) and stamp not in self._images:
            # A late part, or another result as of a replayed frame: show the image again, unless
            # a newer one has come.
            self._images[stamp] = self.latest.image, now
            self._images.move_to_end(stamp, last=False)
            self._results[stamp] = self._latest_results.copy()
        results = self._results.setdefault(stamp, _Results())
        results.parts[part], results.times[part] = content, now
        if part == "status":
            self._last_status_at = now
        while len(self._results) > _MAX_RESULTS:
            self._results.popitem(last=False)

    def choose(self, now: float) -> bool:
        """Update `latest`.

        Returns:
            Whether it has changed.
        """
        oldest = next(iter(self._images), None)
        for stamp, (image, arrival) in reversed(self._images.items()):
            results = self._results.get(stamp) or self._previous_results(stamp)
            complete = results.is_complete(self.required_parts)
            if complete:
                self._latency = max(now - arrival, _LATENCY_DECAY * self._latency)
            status_at = results.times.get("status")
            # The oldest is shown with what it has before the next image drops it.
            is_dropped = status_at is not None and stamp == oldest and self._are_too_many(1)
            if complete or is_dropped or now > self._due_at(arrival, status_at, now):
                self._number += 1
                self._latest_results = results.copy()
                self.latest = DisplayFrame(self._number, stamp, image, self._latest_results.parts)
                older = None
                while older != stamp:
                    older, _ = self._images.popitem(last=False)
                    # Where stamps repeat, as in a loop, the next image needs its own results.
                    self._results.pop(older, None)
                return True
        return False

    def _due_at(self, arrival: float, status_at: float | None, now: float) -> float:
        """When an image is shown without complete results."""
        timeout = max(_TIMEOUT, _LATENCY_FACTOR * self._latency)
        if status_at is not None:
            return max(arrival, status_at) + timeout
        last = self._last_status_at
        if last is not None and self._status_timeout is not None:
            return arrival + self._status_timeout
        is_silent = last is None or now - last > _SILENCE
        return float("-inf") if is_silent else arrival + timeout

    def _previous_results(self, stamp: int) -> _Results:
        """Results of an image with none since its arrival.

        All of them may have come before it, with the previous image of the same stamp.
        """
        return self._latest_results if self._is_latest(stamp) else _Results()

    def _is_latest(self, stamp: int) -> bool:
        return self.latest is not None and stamp == self.latest.stamp
