"""One run over a recording, and what may be asked of it."""

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
    """What a tracker made of a recording.

    Attributes:
        recording: What it was.
        frames: What was found, in order.
        preset: That tracked.
        through: "library" or "node".
        baseline: File of boxes to compare with; None compares with the ground truth.
        reports: Folder for the report and the pictures of a check that fails.
    """

    recording: Recording
    frames: Sequence[FrameSummary]
    preset: str
    backend: str
    baseline: Path | None
    reports: Path

    @property
    def final_state(self) -> str:
        """The state after the last frame that was looked at."""
        return self._states[-1]

    @property
    def mean_overlap(self) -> float:
        """Mean overlap with the reference, 0 to 1; a box that is missing overlaps by 0.

        Of all frames from the target's start on that have a reference; NaN where none has.
        """
        compared = self.overlaps[~np.isnan(self.overlaps)]
        return float(compared.mean()) if compared.size else math.nan

    @cached_property
    def overlaps(self) -> NDArray[np.float64]:
        """(frames,) overlap with the reference, NaN where there is none to compare with."""
        boxes = np.array([each.box or (0.0, 0.0, 0.0, 0.0) for each in self.frames])
        found = metrics.overlap(boxes, self.reference)
        began = next((i for i, state in enumerate(self._states) if state != "idle"), None)
        found[:began] = np.nan
        return found

    @cached_property
    def reference(self) -> NDArray[np.float64]:
        """(frames, 4) the stored boxes, or the true ones; a row of NaN where there is none."""
        if self.baseline is None:
            return np.array([each.true_box or ABSENT for each in self.frames], dtype=np.float64)
        boxes = _read_boxes(self.baseline)
        if len(boxes) != len(self.frames):
            pytest.fail(
                f"{self.baseline} holds {counted(len(boxes), 'frame')}, and {self.recording.path} "
                f"has {len(self.frames)}: it is of another recording; pytest --update stores it "
                "anew",
                pytrace=False,
            )
        return boxes

    @property
    def longest_loss(self) -> float:
        """Seconds of the longest time without the target, 0 if it was never lost."""
        return max((seconds for seconds, _ in self._losses), default=0.0)

    @property
    def milliseconds_per_frame(self) -> float:
        """What the tracker takes for a frame, the median; NaN if it tracked none."""
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
        """Fail the test where the run falls short; what is not given is not asked.

        A failure names the frame, and leaves a report and a picture of that frame.

        Args:
            final_state: State after the last frame, for example "tracking".
            mean_overlap: Least mean overlap with the stored boxes, or without such the true ones.
            longest_loss: Most seconds in a row for which the target may be lost.
            milliseconds_per_frame: Most milliseconds that a frame may take, in the median.
        """
        problems: list[str] = []
        pictured: int | None = None
        if final_state is not None and self.final_state != final_state:
            problems.append(f"the state at the end is {self.final_state}, expected {final_state}")
            pictured = len(self.frames) - 1
        if longest_loss is not None and self.longest_loss > longest_loss:
            seconds, (first, last) = max(self._losses, key=lambda loss: loss[0])
            problems.append(
                f"lost for {seconds:.3g} s in frames {first} to {last}, expected at most "
                f"{longest_loss:g} s"
            )
            pictured = first
        if mean_overlap is not None and not self.mean_overlap >= mean_overlap:
            problem, pictured = self._short_overlap(mean_overlap)
            problems.append(problem)
        if (
            milliseconds_per_frame is not None
            and not self.milliseconds_per_frame <= milliseconds_per_frame
        ):
            problems.append(
                f"a frame takes {self.milliseconds_per_frame:.3g} ms, expected at most {milliseconds_per_frame:g} ms"
            )
        if problems:
            left = self._leave_behind(pictured)
            what = f"{self.recording.path} with {self.preset} through the {self.backend}"
            lines = [f"{what}:", *(f"- {each}" for each in problems), *left]
            pytest.fail("\n".join(lines), pytrace=False)

    def store(self) -> None:
        """Write the boxes as the result to compare with, whole or not at all."""
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
        """The states; of a frame that was not looked at, the one before."""
        states: list[str] = []
        for each in self.frames:
            last = states[-1] if states else "idle"
            states.append(last if each.state == "skipped" else each.state)
        return states

    @property
    def _losses(self) -> list[tuple[float, FrameRange]]:
        """Seconds of each loss up to the frame after it, and its frames."""
        stamps = [each.stamp for each in self.frames]
        ends = [*stamps[1:], stamps[-1]]
        return [
            ((ends[loss.last] - stamps[loss.first]) / NANOSECONDS, loss)
            for loss in frame_ranges(self._states, "lost")
        ]

    def _short_overlap(self, expected: float) -> tuple[str, int | None]:
        kind = "the stored result" if self.baseline else "the truth"
        if math.isnan(self.mean_overlap):
            problem = f"no frame could be compared with {kind}, expected {expected:g}"
            if self.baseline is None:
                problem += "; without a truth give baseline='drive.boxes.csv', and pytest --update"
            return problem, None
        worst = int(np.nanargmin(self.overlaps))
        return (
            f"the overlap with {kind} is {self.mean_overlap:.3f}, expected at least {expected:g}; it is "
            f"least in frame {worst} ({self.overlaps[worst]:.2f})"
        ), worst

    def _leave_behind(self, pictured: int | None) -> list[str]:
        """Write report and picture, and tell where they are."""
        self.reports.mkdir(parents=True, exist_ok=True)
        left = []
        if pictured is not None and (picture := self._picture(pictured)) is not None:
            path = self.reports / f"frame_{pictured:05d}.png"
            # Not by its name, which OpenCV takes as UTF-8 alone.
            path.write_bytes(cv2.imencode(path.suffix, picture)[1].tobytes())
            left.append(f"frame {pictured}: {path}")
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
            left.append(f"report: {path}")
        else:
            left.append("no report: pip install jinja2 matplotlib")
        return left

    def _picture(self, index: int) -> NDArray[Any] | None:
        """A frame with the reference in green and the estimate in the color of its state."""
        with closing(self.recording.frames()) as frames:
            image = next((each.image for each in frames if each.index == index), None)
        if image is None:
            return None
        canvas = draw_overlay(image, None)
        found = self.frames[index]
        color = STATE_COLORS.get(self._states[index], STATE_COLORS["tracking"])
        for box, drawn in ((self.reference[index], _REFERENCE_COLOR), (found.box, color)):
            if box is not None and np.isfinite(box).all():
                draw_box(canvas, np.asarray(box, np.float64), drawn, 2)
        return canvas


def run_library(
    recording: Recording,
    target: Target,
    preset: str,
    parameters: Mapping[str, Any],
    seed: int,
) -> list[FrameSummary]:
    """Track a recording through the library."""
    tracking = track_recording(recording, target, preset=preset, parameters=parameters, seed=seed)
    with closing(tracking) as tracked:
        return [summary_of(each) for each in tracked]


def run_node(
    recording: Recording, target: Target, parameters: Mapping[str, Any], bag_topic: str
) -> list[FrameSummary]:
    """Replay a recording in lockstep into the real node; needs ROS."""
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
    answers = replay_in_lockstep(
        recording.path,
        *start,
        tracker={**parameters, "image_transport": transport},
        replay={"bag_topic": bag_topic},
    )
    summaries = []
    for stamp, true_box in frames:
        values = answers.statuses.get(stamp, {"state": "skipped"})
        is_tracked = values.get("frame") == "tracked"
        summaries.append(
            FrameSummary(
                stamp=stamp,
                state=values["state"],
                box=answers.boxes.get(stamp),
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
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
        if tuple(reader.fieldnames or ()) not in (COLUMNS, LABELED_COLUMNS):
            raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
        names = ("x", "y", "width", "height")
        boxes = [[float(row[name] or math.nan) for name in names] for row in rows]
    except FileNotFoundError:
        problem = f"there is no stored result {path}"
    except (OSError, ValueError, KeyError, TypeError) as error:
        problem = f"{path} is no stored result ({error})"
    # Not while the error is handled, which pytest would show before it.
    if problem:
        pytest.fail(f"{problem}; pytest --update stores one", pytrace=False)
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
