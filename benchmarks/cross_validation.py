"""Groups of sequences for cross-validation, each of which is left out in turn."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import EvaluationError

Groups = Mapping[str, NDArray[np.intp]]


def grouped(names: Sequence[str], patterns: Sequence[str]) -> Groups:
    """Pattern to the indices of the sequences whose names it matches from their start.

    Raises:
        EvaluationError: A pattern is no regular expression or matches no name, or a name is matched
            by none of them or by several.
    """
    groups = {}
    for pattern in patterns:
        try:
            matches = [re.match(pattern, name) is not None for name in names]
        except re.error as error:
            raise EvaluationError(f"--group '{pattern}': {error}") from error
        groups[pattern] = np.flatnonzero(matches)
        if not any(matches):
            raise EvaluationError(f"--group '{pattern}' matches no sequence")
    counts = np.bincount(np.concatenate(list(groups.values())), minlength=len(names))
    for name, count in zip(names, counts, strict=True):
        if count != 1:
            raise EvaluationError(
                f"sequence {name} is in {count} groups; allowed: one --group for each sequence"
            )
    if len(groups) < 2:
        raise EvaluationError("one --group; allowed: at least two, to leave one out")
    return groups
