"""Writes the results of a clip: result.mcap, result.json, overlay.mp4 and contact_sheet.png."""

from __future__ import annotations

import json
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from failure import DemoError
from numpy.typing import NDArray
from recording import BOX, BOXES, OVERLAY, STATUS, Recorder, status_values, target_values
from rich.table import Table

from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.footage import BagWriter
from pf_tracker_ros.footage.video_encoding import open_encoder
from pf_tracker_ros.messages import box_of_polygon

Picture = NDArray[np.uint8]

_SHEET_WIDTH = 1920
_SHEET_TILES = 12
_WIDE = 1.6
_CAPTION_HEIGHT = 26


@dataclass(frozen=True)
class TargetResult:
    """One of several targets in one frame.

    Attributes:
        id: Id of the track.
        label: Label of the track.
        box: As in `FrameResult`.
        state: As in `FrameResult`.
        confidence: 0 to 1.
    """

    id: int
    label: str
    box: tuple[float, float, float, float] | None
    state: str
    confidence: float


@dataclass(frozen=True)
class FrameResult:
    """The tracker's result for one frame.

    Attributes:
        stamp: Stamp of the frame, nanoseconds.
        box: (x, y, width, height), pixels; None while the target is lost, and for several targets.
        state: As in `~/status`.
        confidence: 0 to 1; the mean of several targets, 0 without targets.
        milliseconds: Processing time.
        targets: The targets, if there can be several; otherwise None.
    """

    stamp: int
    box: tuple[float, float, float, float] | None
    state: str
    confidence: float
    milliseconds: float
    targets: tuple[TargetResult, ...] | None = None


def collect(recorder: Recorder, stamps: list[int]) -> list[FrameResult]:
    """The tracker's results in the order of the frames.

    Raises:
        DemoError: A frame has no status, or no target was tracked in it.
    """
    if BOXES in recorder.topics:
        return _collect_several(recorder, stamps)
    statuses, boxes = _statuses(recorder, stamps), recorder.read(BOX)
    results = []
    for index, stamp in enumerate(stamps):
        values = status_values(statuses[stamp])
        if "confidence" not in values:
            raise DemoError(f"the tracker has no target in frame {index}: {values}")
        results.append(
            FrameResult(
                stamp=stamp,
                box=box_of_polygon(boxes[stamp]) if stamp in boxes else None,
                state=values["state"],
                confidence=float(values["confidence"]),
                milliseconds=float(values["processing_time_ms"]),
            )
        )
    return results


def _collect_several(recorder: Recorder, stamps: list[int]) -> list[FrameResult]:
    statuses, markers = _statuses(recorder, stamps), recorder.read(BOXES)
    results = []
    for stamp in stamps:
        values = status_values(statuses[stamp])
        boxes = {
            marker.id: _outline(marker.points)
            for marker in markers[stamp].markers
            if marker.ns == "boxes"
        }
        targets = tuple(
            TargetResult(
                id=int(one["id"]),
                label=one["label"],
                box=boxes.get(int(one["id"])),
                state=one["state"],
                confidence=float(one["confidence"]),
            )
            for one in target_values(statuses[stamp])
        )
        results.append(
            FrameResult(
                stamp=stamp,
                box=None,
                state=values["state"],
                confidence=statistics.mean([one.confidence for one in targets] or [0.0]),
                milliseconds=float(values["processing_time_ms"]),
                targets=targets,
            )
        )
    return results


def _statuses(recorder: Recorder, stamps: list[int]) -> dict[int, Any]:
    statuses = recorder.read(STATUS)
    missing = [index for index, stamp in enumerate(stamps) if stamp not in statuses]
    if missing:
        raise DemoError(f"the tracker published no status for frames {missing}")
    return statuses


def _outline(points: Any) -> tuple[float, float, float, float]:
    """(x, y, width, height) of a rectangle, given clockwise from the top left corner."""
    first, opposite = points[0], points[2]
    return first.x, first.y, opposite.x - first.x, opposite.y - first.y


def write_bag(recorder: Recorder, stamps: list[int], path: Path) -> None:
    """Write the recorded messages of these frames to an MCAP file."""
    with BagWriter(path) as writer:
        for topic, (_, message_type) in recorder.topics.items():
            writer.add_topic(topic, message_type)
        for stamp in stamps:
            for topic in recorder.topics:
                if stamp in recorder.messages[topic]:
                    writer.write(topic, stamp, recorder.messages[topic][stamp])


def write_json(clip: str, results: list[FrameResult], path: Path) -> None:
    """Write an entry for each frame: stamp in seconds, box, state and confidence."""
    frames = []
    for result in results:
        frame = {"stamp": result.stamp / 1e9, **_entry(result)}
        if result.targets is not None:
            frame["targets"] = [
                {"id": one.id, "label": one.label, **_entry(one)} for one in result.targets
            ]
        frames.append(frame)
    path.write_text(json.dumps({"clip": clip, "frames": frames}, indent=1) + "\n")


def _entry(result: FrameResult | TargetResult) -> dict[str, Any]:
    return {
        "box": None if result.box is None else [round(value, 3) for value in result.box],
        "state": result.state,
        "confidence": result.confidence,
    }


def read_overlays(recorder: Recorder, stamps: list[int]) -> list[Picture]:
    """The overlay of each frame, in the size of the footage.

    Raises:
        DemoError: A frame has no overlay.
    """
    messages = recorder.read(OVERLAY)
    missing = [index for index, stamp in enumerate(stamps) if stamp not in messages]
    if missing:
        raise DemoError(f"the tracker published no overlay for frames {missing}")
    return [decode_raw(messages[stamp]) for stamp in stamps]


def write_video(overlays: list[Picture], frame_rate: float, path: Path) -> None:
    """Write the overlays as a video that browsers play.

    Raises:
        FootageError: OpenCV cannot write the file.
    """
    height, width = overlays[0].shape[:2]
    encoder = open_encoder(path, frame_rate, (width, height))
    for overlay in overlays:
        encoder.write(overlay)
    encoder.close()


def write_contact_sheet(overlays: list[Picture], path: Path) -> None:
    """Write equally spaced overlays, with the first and the last one, to one image.

    Raises:
        DemoError: OpenCV cannot write the file.
    """
    height, width = overlays[0].shape[:2]
    columns = 3 if width / height > _WIDE else 4
    chosen = np.linspace(0, len(overlays) - 1, min(len(overlays), _SHEET_TILES)).round().astype(int)
    tiles = [
        _captioned(overlays[index], f"frame {index}", _SHEET_WIDTH // columns) for index in chosen
    ]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    if not cv2.imwrite(str(path), np.vstack(rows)):
        raise DemoError(f"OpenCV cannot write {path}")


def _captioned(picture: Picture, caption: str, width: int) -> Picture:
    scale = width / picture.shape[1]
    tile = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    band = np.zeros((_CAPTION_HEIGHT, tile.shape[1], 3), np.uint8)
    origin = (8, _CAPTION_HEIGHT - 8)
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(band, caption, origin, font, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return np.vstack([band, tile])


def summary_table() -> Table:
    """The summary table, without rows."""
    table = Table(title="Tracked through the ROS node")
    table.add_column("clip")
    for heading in ("frames", "tracking", "confidence", "wall ms a frame"):
        table.add_column(heading, justify="right")
    table.add_column("results")
    return table


@dataclass(frozen=True)
class Summary:
    """Figures of a clip.

    Attributes:
        frames: Number of frames.
        tracking: Share of frames with the state tracking.
        confidence: Mean confidence.
        milliseconds: Median processing time of a frame by the wall clock, with the other processes
            of the demo on the same machine.
    """

    frames: int
    tracking: float
    confidence: float
    milliseconds: float

    @classmethod
    def of(cls, results: list[FrameResult]) -> Summary:
        """The figures of the frames of a clip."""
        return cls(
            frames=len(results),
            tracking=sum(result.state == "tracking" for result in results) / len(results),
            confidence=statistics.mean(result.confidence for result in results),
            milliseconds=statistics.median(result.milliseconds for result in results),
        )


def add_row(table: Table, clip: str, summary: Summary, folder: Any) -> None:
    """Add the row of a clip."""
    table.add_row(
        clip,
        str(summary.frames),
        f"{summary.tracking:.0%}",
        f"{summary.confidence:.2f}",
        f"{summary.milliseconds:.1f}",
        f"{folder}/",
    )
