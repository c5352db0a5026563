"""The univariate growth model: extended Kalman, bootstrap and Kalman-proposal filters compared.

    x_k = x_{k-1} / 2 + 25 x_{k-1} / (1 + x_{k-1}^2) + 8 cos(1.2 k) + u_k,   u_k ~ N(0, 10)
    y_k = x_k^2 / 20 + v_k,                                                  v_k ~ N(0, 1)

100 steps, 100 particles, resampled when the effective sample size falls below 30: the experiment of
Zhang Bo, who reports a mean RMSE of 9.08 for the Kalman-predicted filter. Every filter has the same
states and measurements. The bootstrap filter of the library `particles`, if installed, is an
independent check (extra `benchmark`, in a separate environment, as it requires NumPy 1).

    python benchmarks/growth_model.py --runs 500

It writes `growth_model.md` to the results folder. The exit code is 1 if the
RMSE of the Kalman-proposal filter is not below 9.08, or the bootstrap filters disagree.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import intervals
import numpy as np
from intervals import Interval
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros.filter import (
    EffectiveSampleSizeResampler,
    Gaussian,
    ParticleSet,
    propose_from_prediction,
    propose_from_transition,
)
from pf_tracker_ros.filter.resampling import MultinomialResampler
from pf_tracker_ros.progress import progress_bar

FIRST_STATE = 0.1
STEPS = 100
PARTICLES = 100
THRESHOLD = 30
STATE_VARIANCE = 10.0
MEASUREMENT_VARIANCE = 1.0
SHARE = 0.3
PAPER_RMSE = 9.08

Array = NDArray[np.float64]
Filter = Callable[[Array, int], Array]


def growth(states: Array, step: int) -> Array:
    """Noise-free states in `step`, counted from 1, given those in the step before."""
    return states / 2 + 25 * states / (1 + states**2) + 8 * np.cos(1.2 * step)


def growth_slope(state: float) -> float:
    """Derivative of `growth` by the state."""
    return 0.5 + 25 * (1 - state**2) / (1 + state**2) ** 2


@dataclass(frozen=True)
class GrowthTransition:
    """The model's transition prior in one step, for the proposals."""

    step: int

    def mean(self, states: Array) -> Array:
        """See `Transition.mean`."""
        return growth(states, self.step)

    def std(self, states: Array) -> Array:
        """See `Transition.std`."""
        return np.full(states.shape, np.sqrt(STATE_VARIANCE))


def simulate(seed: int) -> tuple[Array, Array]:
    """(STEPS,) states and (STEPS,) measurements."""
    generator = np.random.default_rng([seed, 0])
    states = np.empty(STEPS)
    state = FIRST_STATE
    for index in range(STEPS):
        noise = np.sqrt(STATE_VARIANCE) * generator.standard_normal()
        state = float(growth(np.asarray(state), index + 1)) + noise
        states[index] = state
    noise = np.sqrt(MEASUREMENT_VARIANCE) * generator.standard_normal(STEPS)
    return states, states**2 / 20 + noise


def extended_kalman(measurements: Array, seed: int) -> Array:
    """Estimates of the extended Kalman filter; the seed is not used."""
    belief = Gaussian(np.array([FIRST_STATE]), np.zeros((1, 1)))
    estimates = np.empty(STEPS)
    for index, measurement in enumerate(measurements):
        belief = _foreseen(belief, index + 1)
        state = belief.mean
        belief = belief.correct(
            [measurement], [state / 10], [[MEASUREMENT_VARIANCE]], expected=state**2 / 20
        )
        estimates[index] = belief.mean[0]
    return estimates


def bootstrap(measurements: Array, seed: int) -> Array:
    """Estimates of the bootstrap filter: particles drawn from the transition prior."""
    return _particle_filter(measurements, seed, share=0.0)


def kalman_proposal(measurements: Array, seed: int) -> Array:
    """Estimates of the filter that draws some of its particles around a Kalman prediction.

    The Kalman filter runs on the state itself: the model's slope at its mean predicts, and the
    particles' mean, with their covariance as its error, corrects it.
    """
    return _particle_filter(measurements, seed, share=SHARE)


def _particle_filter(measurements: Array, seed: int, share: float) -> Array:
    generator = np.random.default_rng([seed, 1])
    resampler = EffectiveSampleSizeResampler(MultinomialResampler(), THRESHOLD / PARTICLES)
    particles = ParticleSet.uniform(np.full((PARTICLES, 1), FIRST_STATE))
    belief = Gaussian(np.array([FIRST_STATE]), np.zeros((1, 1)))
    estimates = np.empty(STEPS)
    for index, measurement in enumerate(measurements):
        transition = GrowthTransition(index + 1)
        if share > 0.0:
            belief = _foreseen(belief, index + 1)
            proposed = propose_from_prediction(
                particles.states, transition, belief, share, generator
            )
        else:
            proposed = propose_from_transition(particles.states, transition, generator)
        error = measurement - proposed.states[:, 0] ** 2 / 20
        log_likelihood = -0.5 * error**2 / MEASUREMENT_VARIANCE
        particles = particles.move(proposed.states).reweight(proposed.log_ratio + log_likelihood)
        if share > 0.0:
            # Particles that collapsed to one point would have zero variance.
            error_covariance = particles.covariance + 1e-6
            belief = belief.correct(particles.mean, np.eye(1), error_covariance)
        estimates[index] = particles.mean[0]
        particles = resampler.resample(particles, PARTICLES, generator)
    return estimates


def _foreseen(belief: Gaussian, step: int) -> Gaussian:
    state = belief.mean
    return belief.predict(
        [[growth_slope(float(state[0]))]], [[STATE_VARIANCE]], mean=growth(state, step)
    )


def library_bootstrap() -> Filter | None:
    """The bootstrap filter of the library `particles` on this model; None if not installed."""
    if importlib.util.find_spec("particles") is None:
        return None
    particles = importlib.import_module("particles")
    distributions = importlib.import_module("particles.distributions")
    models = importlib.import_module("particles.state_space_models")
    collectors = importlib.import_module("particles.collectors")
    noise = np.sqrt(STATE_VARIANCE)

    class Growth(models.StateSpaceModel):
        def PX0(self):  # noqa: N802, the library's name
            return distributions.Normal(loc=float(growth(np.array(FIRST_STATE), 1)), scale=noise)

        def PX(self, t, xp):  # noqa: N802, the library's name
            return distributions.Normal(loc=growth(xp, t + 1), scale=noise)

        def PY(self, t, xp, x):  # noqa: N802, the library's name
            return distributions.Normal(loc=x**2 / 20, scale=np.sqrt(MEASUREMENT_VARIANCE))

    def run(measurements: Array, seed: int) -> Array:
        np.random.seed(seed)  # noqa: NPY002, the only generator that the library takes
        algorithm = particles.SMC(
            fk=models.Bootstrap(ssm=Growth(), data=measurements),
            N=PARTICLES,
            resampling="multinomial",
            ESSrmin=THRESHOLD / PARTICLES,
            collect=[collectors.Moments()],
        )
        algorithm.run()
        return np.array([moments["mean"] for moments in algorithm.summaries.moments])

    return run


@dataclass(frozen=True)
class Outcome:
    """One filter on all runs.

    Attributes:
        name: Of the filter.
        errors: (runs,) root mean square error over the steps of a run.
        milliseconds: (runs,) CPU time of a step.
    """

    name: str
    errors: Array
    milliseconds: Array


def filters() -> dict[str, Filter]:
    """Name to filter; the library's only where it is installed."""
    ours = {
        "extended Kalman": extended_kalman,
        "bootstrap": bootstrap,
        "Kalman proposal": kalman_proposal,
    }
    library = library_bootstrap()
    return ours | ({"bootstrap of `particles`": library} if library else {})


def run_all(runs: int, first_seed: int = 0) -> list[Outcome]:
    """Run every filter on the same `runs` simulations."""
    chosen = filters()
    errors = {name: np.empty(runs) for name in chosen}
    times = {name: np.empty(runs) for name in chosen}
    with progress_bar(runs, "runs") as on_progress:
        for run in range(runs):
            states, measurements = simulate(first_seed + run)
            for name, estimate in chosen.items():
                before = time.process_time()
                estimates = estimate(measurements, first_seed + run)
                times[name][run] = 1000 * (time.process_time() - before) / STEPS
                errors[name][run] = np.sqrt(np.mean((estimates - states) ** 2))
            on_progress("", 1)
    return [Outcome(name, errors[name], times[name]) for name in chosen]


def difference(outcomes: Sequence[Outcome]) -> Interval | None:
    """RMSE of our bootstrap filter minus the library's, paired by run; None without the library."""
    errors = {outcome.name: outcome.errors for outcome in outcomes}
    library = errors.get("bootstrap of `particles`")
    return None if library is None else intervals.mean(errors["bootstrap"] - library)


def table_of(outcomes: Sequence[Outcome]) -> Table:
    """A row for each filter."""
    lines = []
    for outcome in outcomes:
        error, cost = intervals.mean(outcome.errors), intervals.mean(outcome.milliseconds)
        lines.append(
            (
                outcome.name,
                f"{error.value:.2f}",
                f"{error.low:.2f} to {error.high:.2f}",
                f"{cost.value:.3f}",
                f"{cost.low:.3f} to {cost.high:.3f}",
            )
        )
    headings = ("filter", "RMSE", "95 % interval", "CPU ms a step", "95 % interval")
    runs = len(outcomes[0].errors)
    return Table(f"Growth model, {runs} runs of {STEPS} steps", headings, [lines])


def agreement(outcomes: Sequence[Outcome]) -> str:
    """A sentence on the comparison with the library."""
    gap = difference(outcomes)
    if gap is None:
        return "`particles` is not installed (extra `benchmark`): no independent check was made."
    verdict = "they agree" if gap.low <= 0.0 <= gap.high else "they DISAGREE"
    return (
        f"RMSE of our bootstrap filter minus that of `particles`, run by run: {gap.value:+.3f} "
        f"(95 % interval {gap.low:+.3f} to {gap.high:+.3f}): {verdict}."
    )


def write(folder: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the table as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    table = table_of(outcomes)
    lines = [f"# {table.title}", "", *table.markdown()]
    lines += ["", agreement(outcomes), "", f"Zhang Bo reports a mean RMSE of {PAPER_RMSE}.", ""]
    (folder / "growth_model.md").write_text("\n".join(lines), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment, print the table and write the files."""
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--runs", type=options_of.at_least(2), default=500, help="seeded runs [500]"
    )
    options_of.add_folder(parser)
    options = parser.parse_args(arguments)
    outcomes = run_all(options.runs)
    table_of(outcomes).show()
    print(agreement(outcomes))
    try:
        write(options.output, outcomes)
    except OSError as error:
        parser.error(str(error))
    proposal = next(outcome for outcome in outcomes if outcome.name == "Kalman proposal")
    gap = difference(outcomes)
    agrees = gap is None or gap.low <= 0.0 <= gap.high
    return 0 if proposal.errors.mean() < PAPER_RMSE and agrees else 1


if __name__ == "__main__":
    sys.exit(main())
