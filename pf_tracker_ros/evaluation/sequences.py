"""Finds and opens the sequences of an evaluation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from pf_tracker_ros.evaluation.ground_truth import usable_ground_truth
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure
from pf_tracker_ros.footage import Footage, FootageError, read_sequence
from pf_tracker_ros.footage.access import entries, exists, is_folder
from pf_tracker_ros.footage.ground_truth import GROUND_TRUTH_FILES, ground_truth_file
from pf_tracker_ros.footage.sequences import IMAGE_FOLDER


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
