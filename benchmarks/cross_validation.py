"""Cross-validation of settings: does a setting chosen on some footage carry over to other footage?

Each group of sequences is left out in turn. The setting with the best mean on the other groups is
evaluated on it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from outcomes import Outcome
from tables import Table, bold

from pf_tracker_ros.evaluation import EvaluationError

Groups = Mapping[str, NDArray[np.intp]]

_HEADINGS = (
    "left out",
    "sequences",
    "setting chosen on the others",
    "AUC with it",
    "{preset}",
    "best here",
    "setting that is best here",
)
NOTE = (
    "Each group left out in turn: of the variants above, the one with the largest mean AUC on the "
    "sequences of the other groups, and what it scores on this one; for comparison the preset as "
    "it is, and the variant that would have been the best here. Means over a group's sequences; "
    "the last line over all sequences."
)


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


def summary(outcomes: Sequence[Outcome], groups: Groups) -> Table:
    """The setting chosen without each group, and its score there.

    Args:
        outcomes: Of the same sequences, the preset's first.
        groups: As `grouped` gives them.
    """
    scores = np.array([outcome.success_aucs for outcome in outcomes])
    names = [outcome.name for outcome in outcomes]
    rows, totals = [], np.zeros(3)
    for pattern, members in groups.items():
        others = np.setdiff1d(np.arange(scores.shape[1]), members)
        chosen = int(np.argmax(scores[:, others].mean(axis=1)))
        here = scores[:, members].mean(axis=1)
        best = int(np.argmax(here))
        figures = np.array([here[chosen], here[0], here[best]])
        totals += figures * len(members)
        rows.append([pattern, str(len(members)), names[chosen], *_texts(figures), names[best]])
    figures = totals / scores.shape[1]
    last = [bold("all"), str(scores.shape[1]), "", *_texts(figures), ""]
    headings = [heading.format(preset=names[0]) for heading in _HEADINGS]
    return Table("Leave one group out", headings, [rows, [last]])


def _texts(figures: NDArray[np.float64]) -> list[str]:
    return [f"{figure:.3f}" for figure in figures]
