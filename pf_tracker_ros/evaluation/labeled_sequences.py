"""Sequences from footage and a file of labeled boxes, such as one corrected in a labeling tool."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.ground_truth import usable_ground_truth
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure
from pf_tracker_ros.footage import Footage, is_bag, open_footage
from pf_tracker_ros.formats import BoxTrack, FormatError, read_tracks
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted


class LabeledFootage:
    """The frames of footage with a track, from its first to its last box.

    Args:
        footage: The footage.
        track: The track, with a box in its first frame.
        name: Name of the sequence.
    """

    def __init__(self, footage: Footage, track: BoxTrack, name: str) -> None:
        present = [frame for frame, labeled in track.boxes.items() if labeled.box is not None]
        self._footage = footage
        self._first, self._end = present[0], present[-1] + 1
        self.name = name
        self.nominal_interval = footage.nominal_interval
        self.frame_count: int | None = self._end - self._first
        self.ground_truth: NDArray[np.float64] | None = track.ground_truth(self._end)[self._first :]

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        return islice(self._footage.frames(), self._first, self._end)


def open_labeled_sequences(
    sources: Sequence[str | Path], labels: Path
) -> tuple[list[Footage], list[SequenceFailure]]:
    """Open each track of a file of labeled boxes as a sequence.

    Args:
        sources: One video, folder of images or sequence folder.
        labels: The file, in any format of `read_tracks`.

    Returns:
        The sequences, and those that cannot be evaluated.

    Raises:
        EvaluationError: There are several sources, or the file is invalid or belongs to another
            recording.
        FootageError: The source cannot be read.
    """
    if len(sources) != 1:
        raise EvaluationError(
            f"--ground-truth {labels} is for one source, and {len(sources)} are given"
        )
    source = Path(sources[0]).expanduser()
    if source.exists() and is_bag(source):
        raise EvaluationError(
            f"{source} is a bag, which evaluate does not read; allowed: a video, a folder of "
            "images or a sequence folder"
        )
    try:
        tracks = read_tracks(labels)
    except FormatError as error:
        raise EvaluationError(str(error)) from error
    footage = open_footage(source)
    sequences: list[Footage] = []
    failures = []
    for track in tracks:
        name = f"{footage.name}, target {track.id}" if len(tracks) > 1 else footage.name
        sequence = LabeledFootage(footage, track, name)
        _check_length(labels, footage, track)
        try:
            usable_ground_truth(sequence)
            sequences.append(sequence)
        except EvaluationError as error:
            failures.append(SequenceFailure(name, error))
    return sequences, failures


def _check_length(labels: Path, footage: Footage, track: BoxTrack) -> None:
    last = max(frame for frame, labeled in track.boxes.items() if labeled.box is not None)
    if footage.frame_count is not None and last >= footage.frame_count:
        raise EvaluationError(
            f"{labels} has a box in frame {last}, counted from 0, but {footage.name} has "
            f"{counted(footage.frame_count, 'frame')}: it belongs to another recording"
        )
