r"""Ablation study of a preset: without each of its cues, and with other numbers of particles.

Every variant tracks the same sequences with the same seeds. A cue is switched off by weight 0; the
other weights are scaled to a sum of 1. `--off` adds a variant with other parameter values, for
example to switch a mechanism off; several values of one variant are one text.

    python benchmarks/ablation.py SEQUENCE_DIR... --preset default --seeds 3 --jobs 2 \
        --off template.update_above=1 --off "resampling.scheme=multinomial motion.size_noise=0"

With two or more `--group`s it also cross-validates the settings: each group is left out in turn.

It writes ablation.csv and ablation.md.
"""

from __future__ import annotations

import functools
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cross_validation
import intervals
from outcomes import Outcome, figure, write_csv
from tables import Table, bold

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import EvaluationError, evaluate_sequences, read_sequences
from pf_tracker_ros.evaluation.command_line import parse_parameters
from pf_tracker_ros.evaluation.sequences import frame_count
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.tracking.presets import preset_parameters

PARTICLES = (30, 60, 100, 200, 300, 600, 1000)
HEADINGS = (
    "variant",
    "AUC",
    "change [95 %]",
    "± seeds",
    "± mean",
    "precision 20 px",
    "CPU ms",
)
NOTE = (
    "Means over the sequences. The change of the AUC is against the preset; in brackets its 95 % "
    "confidence interval (bootstrap over the sequences), bold where it leaves out 0. ± seeds: "
    "standard deviation of a sequence's AUC over the seeds, mean over the sequences; ± mean: that "
    "of the mean AUC. CPU time of a frame: mean of the sequences' medians."
)


@dataclass(frozen=True)
class Variant:
    """The preset with some parameters changed; none for the preset itself."""

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)


def cue_variants(preset: str) -> list[Variant]:
    """The preset without each of its cues; empty for a preset with a single cue.

    Raises:
        ParameterError: No preset has this name.
    """
    own = preset_parameters(preset)
    used = [name for name in own["cues"] if own[f"{name}.weight"] > 0.0]
    if len(used) < 2:
        return []
    return [Variant(f"without {name}", {f"{name}.weight": 0.0}) for name in used]


def variants(preset: str, particles: Sequence[int], off: Sequence[str]) -> list[Variant]:
    """All variants, the preset itself first.

    Args:
        preset: Name of the preset.
        particles: Numbers of particles; the preset's own is left out, as it stands first.
        off: Texts `NAME=VALUE ...`, a variant each.

    Raises:
        EvaluationError: A text is no assignment, or is given twice.
        ParameterError: No such preset, parameter or value.
    """
    own = preset_parameters(preset)
    found = [Variant(preset), *cue_variants(preset)]
    for text in off:
        assignments = text.split()
        if not assignments:
            raise EvaluationError(f"--off '{text}'; allowed: NAME=VALUE")
        found.append(Variant(" ".join(assignments), parse_parameters(assignments, "--off")))
    found += [
        Variant(f"N = {number}", {"particles": number})
        for number in dict.fromkeys(particles)
        if number != own["particles"]
    ]
    names = [variant.name for variant in found]
    for variant in found:
        if names.count(variant.name) > 1:
            raise EvaluationError(f"--off {variant.name} is given more than once")
        # Checked before the first frame.
        try:
            Tracker.from_preset(preset, parameters=variant.parameters)
        except ParameterError as error:
            raise ParameterError(f"{variant.name}: {error}") from error
        if variant.parameters and own | variant.parameters == own:
            raise EvaluationError(
                f"{variant.name} is the value of preset {preset}; allowed: another value"
            )
    return found


def run(
    preset: str,
    compared: Sequence[Variant],
    sequences: Sequence[Footage],
    seeds: int,
    jobs: int,
) -> list[Outcome]:
    """All variants on all sequences, one variant after the other."""
    outcomes = []
    with progress_bar(frame_count(sequences) * len(compared)) as on_progress:
        for variant in compared:
            make_tracker = functools.partial(
                Tracker.from_preset, preset, parameters=variant.parameters
            )
            results = evaluate_sequences(sequences, make_tracker, range(seeds), jobs, on_progress)
            outcomes.append(Outcome(variant.name, results))
    return outcomes


def summary(outcomes: Sequence[Outcome], title: str) -> Table:
    """The figures of each variant, and the change from the first."""
    base, *others = outcomes
    rows = [_row(outcome, base) for outcome in others]
    return Table(title, HEADINGS, [[_row(base, base)], rows])


def _row(outcome: Outcome, base: Outcome) -> list[str]:
    scores = outcome.scores
    return [
        outcome.name,
        f"{scores.success_auc:.3f}",
        "" if outcome is base else _change(outcome, base),
        figure(outcome.deviation, ".3f"),
        figure(outcome.mean_auc_std, ".3f"),
        f"{scores.precision_20px:.3f}",
        f"{scores.cpu_ms_median:.2f}",
    ]


def _change(outcome: Outcome, base: Outcome) -> str:
    """Change of the success AUC; a single sequence has no interval."""
    change = intervals.mean(outcome.success_aucs - base.success_aucs)
    text = f"{change.value:+.3f}"
    if math.isnan(change.low):
        return text
    return bold(
        f"{text} [{change.low:+.3f}, {change.high:+.3f}]", change.low > 0.0 or change.high < 0.0
    )


def write_markdown(path: Path, table: Table, left_out: Table | None, jobs: int) -> None:
    """Write the tables."""
    timing = "" if jobs == 1 else f" {jobs} processes at a time, so times are not comparable."
    lines = [f"# {table.title}", "", *table.markdown(), "", NOTE + timing]
    if left_out:
        lines += ["", f"## {left_out.title}", "", *left_out.markdown(), "", cross_validation.NOTE]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the ablation, print the table and write the files."""
    parser = options_of.sequence_parser(__doc__)
    options_of.add_preset(parser)
    parser.add_argument(
        "--particles",
        type=_numbers,
        default=PARTICLES,
        metavar="N,N,...",
        help=f"numbers of particles to compare [{','.join(map(str, PARTICLES))}]; '' for none",
    )
    parser.add_argument(
        "--off",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="another variant with changed parameters; may be repeated",
    )
    options_of.add_groups(parser)
    parser.add_argument(
        "--jobs",
        type=options_of.at_least(1),
        default=1,
        metavar="N",
        help="processes, each on one sequence; CPU times are comparable only with one [1]",
    )
    options = parser.parse_args(arguments)
    try:
        compared = variants(options.preset, options.particles, options.off)
        sequences = read_sequences(options.sequences)
        names = [sequence.name for sequence in sequences]
        groups = cross_validation.grouped(names, options.group) if options.group else {}
        options.output.mkdir(parents=True, exist_ok=True)
        outcomes = run(options.preset, compared, sequences, options.seeds, options.jobs)
        seeds = counted(options.seeds, "seed")
        footage = counted(len(sequences), "sequence")
        table = summary(outcomes, f"Ablation of preset {options.preset}: {footage}, {seeds}")
        table.show()
        left_out = cross_validation.summary(outcomes, groups) if groups else None
        if left_out:
            left_out.show()
        write_csv(options.output / "ablation.csv", "variant", outcomes, options.preset)
        write_markdown(options.output / "ablation.md", table, left_out, options.jobs)
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        parser.error(" ".join(str(error).split()))
    print(f"files in {options.output}")
    return 0


def _numbers(text: str) -> tuple[int, ...]:
    number = options_of.at_least(1)
    return tuple(number(part.strip()) for part in text.split(",")) if text else ()


if __name__ == "__main__":
    sys.exit(main())
