"""Finds, opens and checks the sequences of an evaluation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure
from pf_tracker_ros.footage import Footage, FootageError, is_bag, open_footage, read_sequence
from pf_tracker_ros.footage.access import entries, exists, is_folder
from pf_tracker_ros.footage.ground_truth import GROUND_TRUTH_FILES, ground_truth_file
from pf_tracker_ros.footage.sequences import IMAGE_FOLDER, SequenceFootage
from pf_tracker_ros.formats import FormatError, describe_recording, read_tracks
from pf_tracker_ros.plurals import counted


def read_sequences(folders: Iterable[str | Path]) -> list[Footage]:
    """Open the sequence folders among `folders` and directly inside them; failures are raised.

    Args:
        folders: As for `find_sequences`.

    Returns:
        The sequences with ground truth; frames are not read yet.

    Raises:
        EvaluationError: As for `open_sequences`; or a sequence cannot be evaluated, for example
            because its target is absent in the first frame.
        FootageError: A sequence lacks a part, or its ground truth is invalid.
    """
    sequences, failures = open_sequences(folders)
    for failure in failures:
        raise failure.error
    return sequences


def open_sequences(
    folders: Iterable[str | Path],
) -> tuple[list[Footage], list[SequenceFailure]]:
    """Open the sequence folders among `folders` and directly inside them; failures are returned.

    Args:
        folders: As for `find_sequences`.

    Returns:
        The sequences with ground truth, frames not read yet; and the failures.

    Raises:
        EvaluationError: As for `find_sequences`; or two sequences have the same name.
        FootageError: As for `find_sequences`.
    """
    sequences: dict[str, Footage] = {}
    failures = []
    for folder in find_sequences(folders):
        try:
            footage = read_sequence(folder)
            usable_ground_truth(footage)
        except (EvaluationError, FootageError) as error:
            failures.append(SequenceFailure(folder.name, error))
            continue
        if footage.name in sequences:
            raise EvaluationError(
                f"several sequences are named '{footage.name}', the last one in {folder}; "
                "allowed: different names"
            )
        sequences[footage.name] = footage
    return list(sequences.values()), failures


def find_sequences(folders: Iterable[str | Path]) -> list[Path]:
    """The sequence folders among `folders` and directly inside them.

    A folder with a `groundtruth.txt` or `groundtruth_rect.txt` is a sequence. In any other folder,
    the subfolders with such a file, or with frames in `img` (to report missing ground truth), are
    sequences, in order of their names. Duplicates are removed.

    Returns:
        Absolute paths, in the order given.

    Raises:
        EvaluationError: A folder does not exist or contains no sequence.
        FootageError: A folder is not accessible.
    """
    found: dict[Path, None] = {}
    for given in folders:
        folder = Path(given).expanduser().resolve()
        if not (exists(folder) and folder.is_dir()):
            raise EvaluationError(
                f"no folder '{given}'; allowed: a sequence folder, or a folder of such folders"
            )
        sequences = _sequences_of(folder)
        if not sequences:
            raise EvaluationError(
                f"no sequence in '{given}'; allowed: a folder with a "
                f"{' or '.join(GROUND_TRUTH_FILES)}, or a folder of such folders"
            )
        found.update(dict.fromkeys(sequences))
    return list(found)


def frame_count(sequences: Sequence[Footage]) -> int:
    """Number of frames with a true box of all sequences."""
    return sum(0 if one.ground_truth is None else len(one.ground_truth) for one in sequences)


def _sequences_of(folder: Path) -> list[Path]:
    if ground_truth_file(folder) is not None:
        return [folder]
    subfolders = (entry for entry in entries(folder) if is_folder(entry))
    return sorted(entry.resolve() for entry in subfolders if _looks_like_sequence(entry))


def _looks_like_sequence(folder: Path) -> bool:
    images = folder / IMAGE_FOLDER
    try:
        return ground_truth_file(folder) is not None or (exists(images) and images.is_dir())
    except FootageError:
        # Reported when it is opened.
        return True


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
    footage = open_footage(source)
    try:
        images = (frame.image for frame in footage.frames())
        tracks = read_tracks(labels, lambda: describe_recording(footage.name, images))
    except FormatError as error:
        raise EvaluationError(str(error)) from error
    sequences: list[Footage] = []
    failures = []
    for track in tracks:
        name = f"{footage.name}, target {track.id}" if len(tracks) > 1 else footage.name
        present = [frame for frame, labeled in track.boxes.items() if labeled.box is not None]
        first, end = present[0], present[-1] + 1
        if footage.frame_count is not None and end > footage.frame_count:
            raise EvaluationError(
                f"{labels} has a box in frame {end - 1}, counted from 0, but {footage.name} has "
                f"{counted(footage.frame_count, 'frame')}: it belongs to another recording"
            )
        truth = track.ground_truth(end)[first:]
        sequence = SequenceFootage(footage, name, truth, (first, end))
        try:
            usable_ground_truth(sequence)
            sequences.append(sequence)
        except EvaluationError as error:
            failures.append(SequenceFailure(name, error))
    return sequences, failures


def usable_ground_truth(footage: Footage) -> NDArray[np.float64]:
    """The true boxes of a sequence, checked for evaluation.

    Returns:
        (frames, 4) x, y, width, height in pixels. The first has a target; in later frames it may
        be absent, see `metrics.has_target`.

    Raises:
        EvaluationError: No ground truth, fewer than 2 frames, not as many boxes as frames, or no
            target in the first frame.
    """
    if footage.ground_truth is None:
        raise EvaluationError(f"{footage.name}: no ground truth; expected a box for each frame")
    true_boxes = np.array(footage.ground_truth, dtype=np.float64)
    if true_boxes.ndim != 2 or true_boxes.shape[1] != 4 or len(true_boxes) < 2:
        raise EvaluationError(
            f"{footage.name}: ground truth of shape {true_boxes.shape}; "
            "allowed: x, y, width, height of at least 2 frames"
        )
    if not metrics.has_target(true_boxes[0]):
        raise EvaluationError(
            f"{footage.name}: the target is absent in the first frame, where tracking starts; "
            "allowed: finite numbers, width and height above 0"
        )
    if footage.frame_count is not None and footage.frame_count != len(true_boxes):
        raise count_mismatch(footage.name, counted(footage.frame_count, "frame"), len(true_boxes))
    return true_boxes


def count_mismatch(name: str, frames: str, boxes: int) -> EvaluationError:
    """The error for different numbers of frames and true boxes."""
    true_boxes = counted(boxes, "true box", "true boxes")
    return EvaluationError(f"{name}: {frames}, but {true_boxes}; expected a box for each frame")
