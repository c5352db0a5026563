"""The HTML report of a tracked recording. Needs Jinja2 and Matplotlib."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.reports.content import (
    GroundRegion,
    GroundTrack,
    GroundView,
    SequenceContent,
    forward_fill,
)
from pf_tracker_ros.evaluation.reports.page import Report, Section, render
from pf_tracker_ros.evaluation.reports.thumbnails import make_thumbnails
from pf_tracker_ros.evaluation.reports.timeline import RecordingVideo
from pf_tracker_ros.evaluation.results import FrameDetails, Scores
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.video_encoding import playable_rate
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.recordings.keyframes.summary import KeyframeSummary
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.tracking import TrackedFrame, published_box
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.world import FilteredPosition
from pf_tracker_ros.world_messages import region_90

ABSENT = (np.nan, np.nan, np.nan, np.nan)
# A section takes half a megabyte, mostly images.
_MAX_SECTIONS = 20
# Regions on the way of a target.
_MAX_REGIONS = 12


@dataclass(frozen=True)
class FrameSummary:
    """A tracked frame without its image.

    Attributes:
        stamp: Nanoseconds.
        state: `skipped`, `idle`, or the state of the track.
        box: (x, y, width, height) in pixels, or None.
        true_box: Likewise.
        confidence: 0 to 1, NaN if unknown.
        seconds: Processing time, NaN for a frame that was not tracked.
        effective_sample_size: NaN if unknown.
        cue_weights: Name of a cue to its weight.
    """

    stamp: int
    state: str
    box: Box | None
    true_box: Box | None
    confidence: float = np.nan
    seconds: float = np.nan
    effective_sample_size: float = np.nan
    cue_weights: Mapping[str, float] = field(default_factory=dict)


def summary_of(tracked: TrackedFrame, target: TrackedTarget | None = None) -> FrameSummary:
    """Summarize a frame for one of its targets, by default the selected one."""
    estimate = target.estimate if target else tracked.estimate
    return FrameSummary(
        stamp=tracked.frame.stamp,
        state=estimate.state if estimate else tracked.state,
        box=published_box(estimate),
        true_box=tracked.frame.true_box,
        confidence=float(estimate.confidence) if estimate else np.nan,
        seconds=tracked.seconds if tracked.outcome == "tracked" else np.nan,
        effective_sample_size=float(estimate.effective_sample_size) if estimate else np.nan,
        cue_weights=dict(estimate.cue_weights) if estimate else {},
    )


class RecordingReport:
    """Writes the report of one recording after its last frame.

    A single target has one section over all frames, with the scores of an evaluation if there is
    ground truth. With several targets, each has a section, at most the 20 longest.

    Args:
        path: Of the new file.
        recording: The tracked recording; its frames are read again for the images.
        preset: Name of the preset.
        facts: Further facts of the run, name to value.
        fixed_frame: Frame of the positions; empty without positions.
        video: Address of the annotated video, relative to the page; empty without one.
    """

    note = ""

    def __init__(
        self,
        path: Path,
        *,
        recording: Recording,
        preset: str,
        facts: Mapping[str, str],
        fixed_frame: str = "",
        video: str = "",
    ) -> None:
        self._path = path
        self._video = video
        self._image_size = (0, 0)
        self._has_depth = False
        self._recording = recording
        self._preset = preset
        self._given_facts = facts
        self._keyframes = KeyframeSummary()
        self._frames: list[FrameSummary] = []
        self._states: list[str] = []
        self._tracks: dict[int, _Track] = {}
        self._ground = _GroundPaths(fixed_frame) if fixed_frame else None

    def write(self, tracked: TrackedFrame) -> None:
        """Add a frame."""
        self._states.append(tracked.state)
        self._keyframes.add(tracked)
        if tracked.frame.image is not None:
            self._image_size = (tracked.frame.image.shape[1], tracked.frame.image.shape[0])
        if self._ground and tracked.located:
            self._ground.add(tracked.located)
            sensed = tracked.located.sensed
            self._has_depth |= sensed is not None and sensed.depth_offset is not None
        if tracked.max_targets == 1:
            self._frames.append(summary_of(tracked))
            return
        for target in tracked.targets:
            self._tracks.setdefault(target.id, _Track(target.id)).add(tracked, target)

    def close(self) -> None:
        """Write the page.

        Raises:
            OSError: It cannot be written.
        """
        page = self._single_target_page() if self._frames else self._multi_target_page()
        self._path.write_bytes(page.encode("utf-8", "replace"))

    def discard(self) -> None:
        """Do nothing: the file is not open before `close`."""

    @property
    def _recording_video(self) -> RecordingVideo:
        rate = playable_rate(1.0 / self._recording.interval)
        return RecordingVideo(
            self._video, rate, len(self._states), self._image_size, self._has_depth
        )

    @property
    def _facts(self) -> Mapping[str, str]:
        return {**self._given_facts, **(self._keyframes.facts if self._keyframes.given else {})}

    def _single_target_page(self) -> str:
        true_boxes = None
        if self._recording.has_ground_truth:
            true_boxes = np.array([each.true_box or ABSENT for each in self._frames])
        return recording_page(
            self._recording,
            self._frames,
            true_boxes,
            preset=self._preset,
            facts=self._facts,
            ground=self._ground.view if self._ground else None,
            recording_video=self._recording_video,
        )

    def _multi_target_page(self) -> str:
        longest = sorted(self._tracks.values(), key=lambda track: -track.length)[:_MAX_SECTIONS]
        shown = sorted(longest, key=lambda track: track.id)
        contents = [track.content(self._states) for track in shown]
        count = str(len(self._tracks))
        if len(self._tracks) > len(shown):
            count += f", the {len(shown)} with the most frames shown"
        states = Counter(self._states).most_common()
        frames = ", ".join(f"{number} {state}" for state, number in states)
        facts = {**self._facts, "targets": count, "frames": frames}
        return _page(
            self._recording,
            contents,
            preset=self._preset,
            facts=facts,
            kind="target",
            ground=self._ground.view if self._ground else None,
            recording_video=self._recording_video,
        )


def recording_page(
    recording: Recording,
    frames: Sequence[FrameSummary],
    true_boxes: NDArray[np.float64] | None,
    *,
    preset: str,
    facts: Mapping[str, str],
    ground: GroundView | None = None,
    recording_video: RecordingVideo | None = None,
) -> str:
    """The report of a single target, with the scores of an evaluation if there is ground truth.

    Args:
        recording: The tracked recording; its frames are read again for the images.
        frames: Their summaries, in order, at least one.
        true_boxes: (frames, 4) boxes to compare with, or None.
        preset: Name of the preset.
        facts: Further facts of the run, name to value.
        ground: Target and camera from above, None without positions.
        recording_video: For the timeline; None without one.
    """
    content = _content("target", frames, true_boxes)
    content = _with_scores(content, np.array([each.seconds for each in frames]))
    header: dict[str, Any] = {"preset": preset, "facts": facts, "kind": "target"}
    header["mean"] = content.scores
    header |= {"ground": ground, "recording_video": recording_video}
    return _page(recording, [content], **header)


def _page(recording: Recording, contents: Sequence[SequenceContent], **header: Any) -> str:
    def images() -> Iterator[tuple[int, NDArray[Any] | None]]:
        if recording.is_live:
            return
        # The recording may be damaged, or gone by now: the page has the images that can be read.
        with suppress(FootageError), closing(recording.frames()) as frames:
            for frame in frames:
                yield frame.index, frame.image

    thumbnails = make_thumbnails(contents, images())
    sections = list(map(Section, contents, thumbnails))
    return render(Report(title=f"{recording.path.name}, tracked", sections=sections, **header))


def _with_scores(content: SequenceContent, seconds: NDArray[np.float64]) -> SequenceContent:
    overlaps, errors = content.overlaps, content.center_errors
    if overlaps is None or errors is None or np.isnan(overlaps).all():
        return content
    is_timed = not np.isnan(seconds).all()
    return replace(
        content,
        scores=Scores(
            success_auc=metrics.success_auc(overlaps),
            precision_20px=metrics.precision(errors),
            cpu_ms_median=1e3 * float(np.nanmedian(seconds)) if is_timed else np.nan,
            frames=content.frames,
        ),
        success_curve=metrics.success_curve(overlaps),
        precision_curve=metrics.precision_curve(errors),
    )


class _GroundPaths:
    """The ways of targets and camera on the ground."""

    def __init__(self, fixed_frame: str) -> None:
        self._fixed_frame = fixed_frame
        self._camera: list[NDArray[np.float64]] = []
        self._axes: list[NDArray[np.float64]] = []
        self._names: dict[int, str] = {}
        self._frames: list[Mapping[int, FilteredPosition]] = []

    def add(self, located: LocatedFrame) -> None:
        """Add a frame."""
        found = {target.id: target for target in located.world_targets}
        self._frames.append({id: target.filtered for id, target in found.items()})
        self._names |= {id: f"target {id} {one.label}".rstrip() for id, one in found.items()}
        if located.sensed:
            pose = located.sensed.pose.pose
            forward = pose.rotation[:2, 2]
            self._camera.append(pose.translation[:2])
            self._axes.append(forward / max(float(np.linalg.norm(forward)), 1e-9))

    @property
    def view(self) -> GroundView | None:
        """The view from above; None if no target has a position."""
        lengths = Counter(id for frame in self._frames for id in frame)
        shown = sorted(id for id, _ in lengths.most_common(_MAX_SECTIONS))
        if not shown:
            return None
        return GroundView(
            [self._track(id, lengths[id]) for id in shown],
            np.array(self._camera).reshape(-1, 2),
            np.array(self._axes).reshape(-1, 2),
            self._fixed_frame,
        )

    def _track(self, id: int, length: int) -> GroundTrack:
        found = [frame.get(id) for frame in self._frames]
        absent = np.array([np.nan, np.nan])
        positions = np.array([one.position if one else absent for one in found])
        known = [one for one in found if one]
        # The last one, and others at equal distances before it.
        step = max(1, math.ceil(length / _MAX_REGIONS))
        regions = [
            GroundRegion(
                float(one.position[0]),
                float(one.position[1]),
                *region_90(one.covariance[:2, :2]),
            )
            for one in known[::-1][::step]
        ]
        return GroundTrack(self._names[id], positions, regions)


class _Track:
    """The frames of one of several targets, from its first to its last."""

    def __init__(self, id: int) -> None:
        self.id = id
        self._label = ""
        self._frames: dict[int, FrameSummary] = {}

    @property
    def length(self) -> int:
        """Number of frames with the target."""
        return len(self._frames)

    def add(self, tracked: TrackedFrame, target: TrackedTarget) -> None:
        """Add a frame with the target."""
        self._frames[tracked.frame.index] = summary_of(tracked, target)
        self._label = target.label or self._label

    def content(self, states: Sequence[str]) -> SequenceContent:
        """The content of its section, from the states of all frames of the recording."""
        first, end = min(self._frames), max(self._frames) + 1
        frames = [
            self._frames.get(number)
            or FrameSummary(
                0, "skipped" if states[number] == "skipped" else "unreported", None, None
            )
            for number in range(first, end)
        ]
        content = _content(f"target {self.id} {self._label}".rstrip(), frames, None)
        has_ended = any(state != "skipped" for state in states[end:])
        return replace(content, first=first, has_ended=has_ended)


def _content(
    name: str, frames: Sequence[FrameSummary], true_boxes: NDArray[np.float64] | None
) -> SequenceContent:
    """The content of a section, without scores; arguments as for `recording_page`."""
    boxes = forward_fill([each.box for each in frames])
    return SequenceContent(name, boxes, true_boxes, **vars(FrameDetails.of(frames)))
