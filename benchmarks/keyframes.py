"""Semi-automatic labels: how well boxes between keyframes are tracked, and what is left to check.

For each sequence, the truth of every N-th frame is given (`track --keyframes`). Compared are

1. forward: one pass from the first box to the end,
2. restarted: forward passes from each keyframe to the next,
3. joined: forward and backward passes between keyframes.

In 1 and 2, a lost target keeps its last box. In 3, a missing box has overlap 0. Frames without a
target do not count. A frame with an overlap below 0.5 is wrong; the recall is the share of wrong
frames that are listed to be checked.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import arguments
import numpy as np
from numpy.typing import NDArray
from tables import Table, bold

from pf_tracker_ros import Tracker
from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.evaluation import find_sequences, has_target
from pf_tracker_ros.evaluation.metrics import overlap
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.recordings.keyframes.keyframes import KeyframeTrack
from pf_tracker_ros.recordings.keyframes.tracking import track_between_keyframes
from pf_tracker_ros.recordings.recording import Recording, open_recording
from pf_tracker_ros.tracking.presets import preset_parameters

_WRONG_BELOW = 0.5


@dataclass(frozen=True, eq=False)
class Result:
    """The frames of a sequence with a target.

    Attributes:
        name: Name of the sequence.
        is_keyframe: (frames,) whether the truth was given.
        forward: (frames,) overlap of one forward pass.
        restarted: (frames,) overlap of forward passes from each keyframe.
        joined: (frames,) overlap with passes from both sides.
        is_listed: (frames,) whether it is listed to be checked.
    """

    name: str
    is_keyframe: NDArray[np.bool_]
    forward: NDArray[np.float64]
    restarted: NDArray[np.float64]
    joined: NDArray[np.float64]
    is_listed: NDArray[np.bool_]

    @property
    def row(self) -> list[str]:
        """Cells of the table."""
        wrong = self.joined < _WRONG_BELOW
        recall = f"{self.is_listed[wrong].mean():.2f}" if wrong.any() else ""
        means = [f"{each.mean():.3f}" for each in (self.forward, self.restarted, self.joined)]
        counts = [str(len(wrong)), str(self.is_keyframe.sum())]
        return [
            self.name,
            *counts,
            *means,
            str(wrong.sum()),
            recall,
            f"{self.is_listed.mean():.2f}",
        ]


def measure(path: Path, every: int, preset: str, seed: int) -> Result:
    """Measure one sequence.

    Args:
        path: Its folder.
        every: Frames from a keyframe to the next.
        preset: Name of the preset.
        seed: Of the trackers.
    """
    recording = open_recording(path)
    truth = _truth(recording)
    keyframes = {
        frame: as_box(truth[frame]) if has_target(truth[frame]) else None
        for frame in range(0, len(truth), every)
    }
    forward = _forward(recording, {0: keyframes[0]}, len(truth), preset, seed)
    restarted = _forward(recording, keyframes, len(truth), preset, seed)
    joined, is_listed = np.zeros((len(truth), 4)), np.zeros(len(truth), dtype=bool)
    track = KeyframeTrack(1, "", keyframes, str(path))
    parameters = preset_parameters(preset)
    for tracked in track_between_keyframes(recording, [track], parameters=parameters, seed=seed):
        if tracked.box is not None:
            joined[tracked.frame.index] = tracked.box
        is_listed[tracked.frame.index] = bool(tracked.to_check)
    counts = has_target(truth)
    is_keyframe = np.arange(len(truth)) % every == 0
    return Result(
        path.name,
        is_keyframe[counts],
        *(overlap(boxes[counts], truth[counts]) for boxes in (forward, restarted, joined)),
        is_listed[counts],
    )


def _truth(recording: Recording) -> NDArray[np.float64]:
    absent = (np.nan,) * 4
    return np.array([frame.true_box or absent for frame in recording.frames()])


def _forward(
    recording: Recording,
    keyframes: Mapping[int, Box | None],
    frames: int,
    preset: str,
    seed: int,
) -> NDArray[np.float64]:
    """(frames, 4) boxes of forward passes from each keyframe with a box."""
    tracker = Tracker.from_preset(preset, seed)
    boxes = np.zeros((frames, 4))
    last = boxes[0]
    with one_opencv_thread():
        for frame in recording.frames():
            assert frame.image is not None
            box = keyframes.get(frame.index)
            if box is not None:
                tracker.start(frame.image, box)
                last = np.array(box)
            elif tracker.started:
                estimate = tracker.update(frame.image, recording.interval)
                last = last if estimate.state == "lost" else np.array(estimate.box)
            boxes[frame.index] = last
    return boxes


def _pooled(results: Sequence[Result], title: str) -> list[str]:
    """Cells with the means over the sequences, and the recall and share listed over all frames."""
    means = [
        f"{np.mean([getattr(each, name).mean() for each in results]):.3f}"
        for name in ("forward", "restarted", "joined")
    ]
    wrong = np.concatenate([each.joined < _WRONG_BELOW for each in results])
    listed = np.concatenate([each.is_listed for each in results])
    recall = f"{listed[wrong].mean():.2f}" if wrong.any() else ""
    keyframes = sum(int(each.is_keyframe.sum()) for each in results)
    cells = [str(len(wrong)), str(keyframes), *means, str(wrong.sum()), recall]
    return [bold(each) for each in (title, *cells, f"{listed.mean():.2f}")]


def _results(options: argparse.Namespace) -> Iterator[Result]:
    for path in find_sequences(options.sequences):
        if _frame_count(path) > options.every:
            yield measure(path, options.every, options.preset, options.seed)


def _frame_count(path: Path) -> int:
    return open_recording(path).frame_count or 0


def main() -> int:
    """Run the benchmark."""
    made = arguments.parser(__doc__)
    made.add_argument("sequences", nargs="+", type=Path, metavar="SEQUENCE_DIR")
    made.add_argument("--every", type=arguments.at_least(2), default=60, help="[%(default)s]")
    made.add_argument("--seed", type=arguments.at_least(0), default=0, help="[%(default)s]")
    arguments.add_preset(made)
    options = made.parse_args()
    results = list(_results(options))
    if not results:
        print(f"no sequence with more than {options.every} frames", file=sys.stderr)
        return 2
    headings = (
        "",
        "frames",
        "given",
        "forward",
        "restarted",
        "joined",
        "wrong",
        "recall",
        "listed",
    )
    title = f"keyframes every {options.every} frames: mean overlap, wrong frames, listed frames"
    rows = [each.row for each in results]
    mean = _pooled(results, f"{len(results)} sequences")
    Table(title, headings, [rows, [mean]]).show()
    return 0


if __name__ == "__main__":
    sys.exit(main())
