"""The report of a recording with several targets. Needs Jinja2 and Matplotlib."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pf_tracker_ros.evaluation.reports.content import SequenceContent
from pf_tracker_ros.evaluation.reports.page import Report, Section, render
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.report import pictures_of
from pf_tracker_ros.recordings.several import TrackedTargets, row_of
from pf_tracker_ros.recordings.summaries import FrameSummary, content_of_frames
from pf_tracker_ros.recordings.tracking import Tracked
from pf_tracker_ros.targets.tracked_target import TrackedTarget

# A section is half a megabyte, most of it pictures.
_MOST_SECTIONS = 20


class KnownTargets:
    """What is known of a recording with several targets, which have a section each; see `Known`.

    Of many targets those are shown that were followed through the most frames.
    """

    def __init__(self) -> None:
        self._lives: dict[int, _Life] = {}
        self._states: list[str] = []

    def add(self, tracked: Tracked) -> None:
        """Take what is known of a frame."""
        assert isinstance(tracked, TrackedTargets)
        self._states.append(tracked.state)
        for target in tracked.targets:
            life = self._lives.setdefault(target.id, _Life(target.id))
            life.add(tracked, target)

    def page(self, recording: Recording, preset: str, facts: Mapping[str, str]) -> str:
        """The page; see `RecordingReport`."""
        longest = sorted(self._lives.values(), key=lambda life: -life.seen)[:_MOST_SECTIONS]
        contents = [
            life.content_among(self._states) for life in sorted(longest, key=lambda life: life.id)
        ]
        count = str(len(self._lives))
        if len(self._lives) > len(contents):
            count += f", of which the {len(contents)} that were followed longest are shown"
        states = ", ".join(
            f"{number} {state}" for state, number in Counter(self._states).most_common()
        )
        facts = {**facts, "targets": count, "frames": states}
        pictures = pictures_of(contents, recording)
        return render(
            Report(
                title=f"{recording.path.name}, tracked",
                preset=preset,
                facts=facts,
                sections=list(map(Section, contents, pictures)),
                kind="target",
            )
        )


class _Life:
    """What is known of a target from its first frame to its last one.

    Attributes:
        id: Its own.
        seen: Number of frames in which it was told.

    Args:
        id: As the attribute.
    """

    def __init__(self, id: int) -> None:
        self.id = id
        self.seen = 0
        self._first = 0
        self._label = ""
        self._frames: list[FrameSummary | None] = []

    def add(self, tracked: TrackedTargets, target: TrackedTarget) -> None:
        """Take it in a frame."""
        number = tracked.frame.index
        if not self._frames:
            self._first = number
        missed = number - self._first - len(self._frames)
        self._frames += [None] * missed
        row, estimate = row_of(target), target.estimate
        self._frames.append(
            FrameSummary(
                stamp=tracked.frame.stamp,
                state=row.state,
                box=row.box,
                true_box=None,
                confidence=float(estimate.confidence),
                seconds=np.nan,
                effective_sample_size=float(estimate.effective_sample_size),
                powers=dict(estimate.powers),
            )
        )
        self.seen += 1
        self._label = target.label or self._label

    def content_among(self, states: Sequence[str]) -> SequenceContent:
        """What there is to tell of it.

        Args:
            states: Of all frames.
        """
        frames = [
            frame or FrameSummary(0, "skipped" if state == "skipped" else "absent", None, None)
            for frame, state in zip(self._frames, states[self._first :], strict=False)
        ]
        name = f"target {self.id} {self._label}".rstrip()
        later = states[self._first + len(frames) :]
        has_ended = any(state != "skipped" for state in later)
        content = content_of_frames(name, frames, None)
        return replace(content, first=self._first, has_ended=has_ended)
