"""A tracker's run over a recording, and its checks."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pf_tracker_ros.atomic_files import atomic_write
from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.reports.content import FrameRange, frame_ranges
from pf_tracker_ros.evaluation.reports.page import REPORT_FILE
from pf_tracker_ros.footage.access import check_file
from pf_tracker_ros.footage.bags import COMPRESSED_IMAGE_TYPE, is_bag, open_bag
from pf_tracker_ros.overlay import STATE_COLORS, draw_box, draw_overlay
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.report import ABSENT, FrameSummary, recording_page, summary_of
from pf_tracker_ros.recordings.tables import COLUMNS, LABELED_COLUMNS
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.recordings.tracking import track_recording
from pf_tracker_ros.stamps import NANOSECONDS

_REFERENCE_COLOR = (80, 220, 80)


@dataclass(frozen=True, eq=False)
class TrackedRun:
    """A tracker's result on a recording.

    Attributes:
        recording: The recording.
        frames: The result of each frame, in order.
        preset: The preset.
        backend: "library" or "node".
        baseline: File of boxes to compare with; None compares with the ground truth.
        reports: Folder for the report and the image of a failed check.
    """

    recording: Recording
    frames: Sequence[FrameSummary]
    preset: str
    backend: str
    baseline: Path | None
    reports: Path

    @property
    def final_state(self) -> str:
        """The state after the last processed frame."""
        return self._states[-1]

    @property
    def mean_overlap(self) -> float:
        """Mean overlap with the reference, 0 to 1; a missing box has overlap 0.

        Over all frames with a reference from the target's start on; NaN without any.
        """
        compared = self.overlaps[~np.isnan(self.overlaps)]
        return float(compared.mean()) if compared.size else math.nan

    @cached_property
    def overlaps(self) -> NDArray[np.float64]:
        """(frames,) overlap with the reference, NaN without reference."""
        boxes = np.array([each.box or (0.0, 0.0, 0.0, 0.0) for each in self.frames])
        overlaps = metrics.overlap(boxes, self.reference)
        start = next((i for i, state in enumerate(self._states) if state != "idle"), None)
        overlaps[:start] = np.nan
        return overlaps

    @cached_property
    def reference(self) -> NDArray[np.float64]:
        """(frames, 4) boxes of the baseline, or true boxes; a row of NaN without box."""
        if self.baseline is None:
            return np.array([each.true_box or ABSENT for each in self.frames], dtype=np.float64)
        boxes = _read_boxes(self.baseline)
        if len(boxes) != len(self.frames):
            pytest.fail(
                f"{self.baseline} has {counted(len(boxes), 'frame')}, but {self.recording.path} "
                f"has {len(self.frames)}: it belongs to another recording; pytest --update "
                "replaces it",
                pytrace=False,
            )
        return boxes

    @property
    def longest_loss(self) -> float:
        """Duration of the longest loss in seconds, 0 without any."""
        return max((seconds for seconds, _ in self._losses), default=0.0)

    @property
    def milliseconds_per_frame(self) -> float:
        """Median processing time of a frame; NaN if none was tracked."""
        seconds = np.array([each.seconds for each in self.frames])
        return math.nan if np.isnan(seconds).all() else 1e3 * float(np.nanmedian(seconds))

    def check(
        self,
        *,
        final_state: str | None = None,
        mean_overlap: float | None = None,
        longest_loss: float | None = None,
        milliseconds_per_frame: float | None = None,
    ) -> None:
        """Fail the test if the run misses a limit; None sets no limit.

        A failure names the frame, and writes a report and an image of that frame.

        Args:
            final_state: State after the last frame, for example "tracking".
            mean_overlap: Minimum of the mean overlap with the baseline or the ground truth.
            longest_loss: Maximum duration of a loss in seconds.
            milliseconds_per_frame: Maximum of the median processing time.
        """
        problems: list[str] = []
        shown_frame: int | None = None
        if final_state is not None and self.final_state != final_state:
            problems.append(f"the final state is {self.final_state}, expected {final_state}")
            shown_frame = len(self.frames) - 1
        if longest_loss is not None and self.longest_loss > longest_loss:
            seconds, (first, last) = max(self._losses, key=lambda loss: loss[0])
            problems.append(
                f"lost for {seconds:.3g} s in frames {first} to {last}, expected at most "
                f"{longest_loss:g} s"
            )
            shown_frame = first
        if mean_overlap is not None and not self.mean_overlap >= mean_overlap:
            problem, shown_frame = self._overlap_problem(mean_overlap)
            problems.append(problem)
        if (
            milliseconds_per_frame is not None
            and not self.milliseconds_per_frame <= milliseconds_per_frame
        ):
            problems.append(
                f"a frame takes {self.milliseconds_per_frame:.3g} ms, expected at most "
                f"{milliseconds_per_frame:g} ms"
            )
        if problems:
            files = self._write_report(shown_frame)
            run = f"{self.recording.path} with preset {self.preset}, backend {self.backend}"
            lines = [f"{run}:", *(f"- {each}" for each in problems), *files]
            pytest.fail("\n".join(lines), pytrace=False)

    def store(self) -> None:
        """Write the boxes as the baseline."""
        if self.baseline is None:
            return
        self.baseline.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self.baseline) as draft, draft.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for index, each in enumerate(self.frames):
                box = each.box or ("", "", "", "")
                confidence = "" if math.isnan(each.confidence) else each.confidence
                writer.writerow([index, each.stamp, 1, *box, each.state, confidence])

    @cached_property
    def _states(self) -> list[str]:
        """State of each frame; a skipped frame has the last state."""
        states: list[str] = []
        for each in self.frames:
            last = states[-1] if states else "idle"
            states.append(last if each.state == "skipped" else each.state)
        return states

    @property
    def _losses(self) -> list[tuple[float, FrameRange]]:
        """Duration in seconds, up to the next frame, and frames of each loss."""
        stamps = [each.stamp for each in self.frames]
        ends = [*stamps[1:], stamps[-1]]
        return [
            ((ends[loss.last] - stamps[loss.first]) / NANOSECONDS, loss)
            for loss in frame_ranges(self._states, "lost")
        ]

    def _overlap_problem(self, expected: float) -> tuple[str, int | None]:
        """Message about a low mean overlap, and the worst frame."""
        kind = "the baseline" if self.baseline else "the ground truth"
        if math.isnan(self.mean_overlap):
            problem = f"no frame could be compared with {kind}, expected {expected:g}"
            if self.baseline is None:
                problem += "; set baseline='drive.boxes.csv' and run pytest --update"
            return problem, None
        worst = int(np.nanargmin(self.overlaps))
        return (
            f"the overlap with {kind} is {self.mean_overlap:.3f}, expected at least {expected:g}; "
            f"it is lowest in frame {worst} ({self.overlaps[worst]:.2f})"
        ), worst

    def _write_report(self, shown_frame: int | None) -> list[str]:
        """Write the image of a frame and the report; returns lines with their paths."""
        self.reports.mkdir(parents=True, exist_ok=True)
        lines = []
        if shown_frame is not None and (image := self._drawn_frame(shown_frame)) is not None:
            path = self.reports / f"frame_{shown_frame:05d}.png"
            # OpenCV writes only file names in UTF-8.
            path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())
            lines.append(f"frame {shown_frame}: {path}")
        if find_spec("jinja2") and find_spec("matplotlib"):
            has_reference = bool(np.isfinite(self.reference).any())
            page = recording_page(
                self.recording,
                self.frames,
                self.reference if has_reference else None,
                preset=self.preset,
                facts={"recording": str(self.recording.path), "backend": self.backend},
            )
            path = self.reports / REPORT_FILE
            path.write_text(page, encoding="utf-8", errors="replace")
            lines.append(f"report: {path}")
        else:
            lines.append("no report: pip install jinja2 matplotlib")
        return lines

    def _drawn_frame(self, index: int) -> NDArray[Any] | None:
        """A frame with the reference in green and the estimate in the color of its state."""
        with closing(self.recording.frames()) as frames:
            image = next((each.image for each in frames if each.index == index), None)
        if image is None:
            return None
        canvas = draw_overlay(image, None)
        state_color = STATE_COLORS.get(self._states[index], STATE_COLORS["tracking"])
        for box, color in (
            (self.reference[index], _REFERENCE_COLOR),
            (self.frames[index].box, state_color),
        ):
            if box is not None and np.isfinite(box).all():
                draw_box(canvas, np.asarray(box, np.float64), color, 2)
        return canvas


def run_library(
    recording: Recording,
    target: Target,
    preset: str,
    parameters: Mapping[str, Any],
    seed: int,
) -> list[FrameSummary]:
    """Track a recording with the library."""
    tracking = track_recording(recording, target, preset=preset, parameters=parameters, seed=seed)
    with closing(tracking) as tracked:
        return [summary_of(each) for each in tracked]


def run_node(
    recording: Recording, target: Target, parameters: Mapping[str, Any], bag_topic: str
) -> list[FrameSummary]:
    """Track a recording with the node, by a replay in lockstep; needs ROS."""
    from pf_tracker_ros.node.replay.lockstep import replay_in_lockstep

    frames = []
    start = None
    with closing(recording.frames()) as recorded:
        for frame in recorded:
            frames.append((frame.stamp, frame.true_box))
            if start is None and (box := target.box_in(frame)) is not None:
                start = box, frame.stamp
    if start is None:
        raise target.not_found_error()
    transport = "raw"
    if is_bag(recording.path):
        is_compressed = open_bag(recording.path, bag_topic).image_type == COMPRESSED_IMAGE_TYPE
        transport = "compressed" if is_compressed else "raw"
    result = replay_in_lockstep(
        recording.path,
        *start,
        tracker={**parameters, "image_transport": transport},
        replay={"bag_topic": bag_topic},
    )
    summaries = []
    for stamp, true_box in frames:
        values = result.statuses.get(stamp, {"state": "skipped"})
        is_tracked = values.get("frame") == "tracked"
        summaries.append(
            FrameSummary(
                stamp=stamp,
                state=values["state"],
                box=result.boxes.get(stamp),
                true_box=true_box,
                confidence=float(values.get("confidence", math.nan)),
                seconds=float(values["processing_time_ms"]) / 1e3 if is_tracked else math.nan,
                effective_sample_size=float(values.get("effective_sample_size", math.nan)),
                cue_weights={
                    name.removeprefix("cue_weight_"): float(value)
                    for name, value in values.items()
                    if name.startswith("cue_weight_")
                },
            )
        )
    return summaries


def _read_boxes(path: Path) -> NDArray[np.float64]:
    problem = ""
    try:
        if path.exists():
            check_file(path, "baseline")
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
        if tuple(reader.fieldnames or ()) not in (COLUMNS, LABELED_COLUMNS):
            raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
        names = ("x", "y", "width", "height")
        boxes = [[float(row[name] or math.nan) for name in names] for row in rows]
    except FileNotFoundError:
        problem = f"there is no baseline {path}"
    except (OSError, ValueError, KeyError, TypeError) as error:
        problem = f"{path} is no baseline ({error})"
    # Outside the except clause, as pytest would show the handled error as well.
    if problem:
        pytest.fail(f"{problem}; pytest --update stores one", pytrace=False)
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
