"""What is left to a person after tracking between keyframes: a list, counts and clicks."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from pf_tracker_ros.plurals import counted
from pf_tracker_ros.recordings.tracking import TrackedFrame, published_box

FRAMES_TO_CHECK = "frames_to_check.csv"
_COLUMNS = ("frame", "stamp", "id", "confidence", "reason")
# A box is drawn with a click on each of two corners.
_CLICKS = 2
_MAX_RANGES = 8


class FramesToCheck:
    """Writes the frames that a person should look at as CSV, a row for each frame and target.

    Args:
        path: Of the new file.

    Raises:
        OSError: It cannot be written.
    """

    note = ""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(_COLUMNS)

    def write(self, tracked: TrackedFrame) -> None:
        """Write the rows of a frame."""
        for target in tracked.targets:
            if reason := tracked.to_check.get(target.id):
                confidence = float(target.estimate.confidence)
                frame = (tracked.frame.index, tracked.frame.stamp)
                self._writer.writerow((*frame, target.id, f"{confidence:.4f}", reason))

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    discard = close


class KeyframeSummary:
    """Counts the boxes by who is in charge of them.

    Attributes:
        given: Boxes of keyframes.
        tracked: Boxes between them.
        to_check: Boxes of these to check, also of frames where the target was lost.
    """

    def __init__(self) -> None:
        self.given = 0
        self.tracked = 0
        self.to_check = 0
        self._frames: list[int] = []

    def add(self, tracked: TrackedFrame) -> None:
        """Add a frame."""
        for target in tracked.targets:
            if target.id in tracked.keyframes:
                self.given += 1
            elif target.id in tracked.to_check:
                self.to_check += 1
                self.tracked += 1
            elif published_box(target.estimate) is not None:
                self.tracked += 1
        if tracked.to_check:
            self._frames.append(tracked.frame.index)

    @property
    def facts(self) -> Mapping[str, str]:
        """The counts for a report."""
        saved = self.tracked - self.to_check
        return {
            "keyframes": f"{self.given}, and {counted(self.tracked, 'box', 'boxes')} in between",
            "frames to check": f"{len(self._frames)}: {_ranges_text(self._frames)}"
            if self._frames
            else "none",
            "clicks saved": f"{_CLICKS * saved}, {_CLICKS} for each of {saved} boxes neither given "
            "nor to check",
        }

    @property
    def text(self) -> str:
        """The counts in one line."""
        facts = self.facts
        where = f" (frames from 0, see {FRAMES_TO_CHECK})" if self._frames else ""
        return (
            f"keyframes: {facts['keyframes']}; frames to check: {facts['frames to check']}"
            f"{where}; clicks saved: {facts['clicks saved']}"
        )


def _ranges_text(frames: Sequence[int]) -> str:
    ranges: list[list[int]] = []
    for frame in frames:
        if ranges and frame == ranges[-1][-1] + 1:
            ranges[-1][1:] = [frame]
        else:
            ranges.append([frame])
    shown = ["-".join(map(str, each)) for each in ranges[:_MAX_RANGES]]
    rest = len(ranges) - len(shown)
    return ", ".join(shown) + (f" and {counted(rest, 'more range')}" if rest else "")
