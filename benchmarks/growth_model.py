"""The univariate growth model: bootstrap and Kalman-proposal filters compared.

    x_k = x_{k-1} / 2 + 25 x_{k-1} / (1 + x_{k-1}^2) + 8 cos(1.2 k) + u_k,   u_k ~ N(0, 10)
    y_k = x_k^2 / 20 + v_k,                                                  v_k ~ N(0, 1)

100 steps, 100 particles, resampled when the effective sample size falls below 30: the experiment of
Zhang Bo, who reports a mean RMSE of 9.08 for the Kalman-predicted filter. Every filter has the same
states and measurements.

    python benchmarks/growth_model.py --runs 500
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import arguments as options_of
import numpy as np
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

FIRST_STATE, STEPS = 0.1, 100
PARTICLES, THRESHOLD, SHARE = 100, 30, 0.3
STATE_VARIANCE, MEASUREMENT_VARIANCE = 10.0, 1.0

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


def particle_filter(measurements: Array, seed: int, share: float) -> Array:
    """Estimates of the filter that draws a share of its particles around a Kalman prediction.

    The Kalman filter runs on the state itself: the model's slope at its mean predicts, and the
    particles' mean, with their covariance as its error, corrects it. With a share of 0 this is the
    bootstrap filter: all particles are drawn from the transition prior.
    """
    generator = np.random.default_rng([seed, 1])
    resampler = EffectiveSampleSizeResampler(MultinomialResampler(), THRESHOLD / PARTICLES)
    particles = ParticleSet.uniform(np.full((PARTICLES, 1), FIRST_STATE))
    belief = Gaussian(np.array([FIRST_STATE]), np.zeros((1, 1)))
    estimates = np.empty(STEPS)
    for index, measurement in enumerate(measurements):
        transition = GrowthTransition(index + 1)
        if share > 0.0:
            mean, slope = belief.mean, [[growth_slope(float(belief.mean[0]))]]
            belief = belief.predict(slope, [[STATE_VARIANCE]], mean=growth(mean, index + 1))
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


FILTERS: Mapping[str, Filter] = {
    "bootstrap": functools.partial(particle_filter, share=0.0),
    "Kalman proposal": functools.partial(particle_filter, share=SHARE),
}


def table_of(runs: int) -> Table:
    """All filters on the same simulations; the error of the mean is its standard error."""
    errors, seconds = np.empty((len(FILTERS), runs)), np.zeros(len(FILTERS))
    with progress_bar(runs, "runs") as on_progress:
        for run in range(runs):
            states, measurements = simulate(run)
            for number, estimate in enumerate(FILTERS.values()):
                before = time.process_time()
                estimates = estimate(measurements, run)
                seconds[number] += time.process_time() - before
                errors[number, run] = np.sqrt(np.mean((estimates - states) ** 2))
            on_progress("", 1)
    rows = [
        [
            name,
            f"{of_one.mean():.2f}",
            f"{of_one.std(ddof=1) / np.sqrt(runs):.2f}",
            f"{1e3 * spent / runs / STEPS:.3f}",
        ]
        for name, of_one, spent in zip(FILTERS, errors, seconds, strict=True)
    ]
    headings = ("filter", "RMSE", "± of the mean", "CPU ms a step")
    return Table(f"Growth model, {runs} runs of {STEPS} steps", headings, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment and print the table."""
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--runs", type=options_of.at_least(2), default=500, help="seeded runs [500]"
    )
    table_of(parser.parse_args(arguments).runs).show()


if __name__ == "__main__":
    main()
