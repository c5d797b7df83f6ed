"""Section 3.3: is the noise of weights on connections to the output n times that of internal ones?

Claim: "the variances of weights on connections to the linear output unit were usually n times larger than those on
internal connections, n being the total number of neurons", and internal ones are "all of the same order of
magnitude".

Measured: v_i of section 3.2 (beta = 1/100, v_i(0) = 0) while cascades of n neurons learn at fixed rates, one v_i
per connection, at several moments of training. Once with the output unit's rate scaled by 1 / sqrt(n), once with
one global rate (pendulum only), which is then 1 / sqrt(n) of the first case's, so that the output unit learns
equally fast in both. v_i itself does not depend on the rate but through what is learned, because changes are
divided by it.

Chosen: eta 0.04 (with scaling), s_gamma and s_lambda 1 1/s, trials of 5 s, float32.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats

from swimmer_mj.learning.experiments.noise import NoiseMeter
from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD

__all__ = ["HEADER", "LOG", "noise_summary", "power_of_n", "run"]

LOG = "section-3.3.csv"

ETA = 0.04
HEADER = (
    "problem",
    "n",
    "output_scaling",
    "seed",
    "trial",
    "output",  # mean of v over connections to the output unit
    "internal",  # mean of v over all others
    "from_inputs",  # internal ones from inputs and bias
    "from_neurons",  # internal ones from hidden neurons
    "internal_p05",  # quantiles over internal connections
    "internal_p50",
    "internal_p95",
    "neuron_p05",  # quantiles over hidden neurons of the mean of v over a neuron's connections
    "neuron_p95",
    "mean_over_deviation",  # median over all connections of |mean gradient| / sqrt(v)
    "value",  # mean V over the trial law's states, 256 of them
)

PENDULUM_NEURONS = (8, 15, 30, 60, 120)
SWIMMER_NEURONS = (15, 30, 60, 120)
PENDULUM_MOMENTS = (500, 1000, 2000, 4000)
SWIMMER_MOMENTS = (500, 2000, 5000, 20_000)


def noise_summary(
    variance: NDArray[np.float64], mean: NDArray[np.float64], n_inputs: int
) -> tuple[float, ...]:
    """Columns "output" to "mean_over_deviation" of :data:`HEADER`.

    ``variance`` and ``mean``: v_i and the mean gradient, shape (n, m + n), as the weights of a cascade.
    """
    n, sources = variance.shape
    source = np.arange(sources)
    connected = source[None, :] <= n_inputs + np.arange(n)[:, None]
    hidden = connected[:-1]
    output = variance[-1].mean()
    internal = variance[:-1][hidden]
    early = hidden & (source <= n_inputs)
    late = hidden & (source > n_inputs)
    by_neuron = np.where(hidden, variance[:-1], 0.0).sum(axis=1) / hidden.sum(axis=1)
    ratio = np.abs(mean[connected]) / np.sqrt(np.maximum(variance[connected], 1e-300))
    return (
        output,
        internal.mean(),
        variance[:-1][early].mean(),
        variance[:-1][late].mean() if late.any() else np.nan,
        *np.quantile(internal, [0.05, 0.5, 0.95]),
        *np.quantile(by_neuron, [0.05, 0.95]),
        np.median(ratio),
    )


def power_of_n(n: NDArray[np.float64], ratio: NDArray[np.float64]) -> tuple[float, float, float]:
    """b of ratio ~ n^b: estimate, half its 95 % interval, p of b = 1.

    By least squares of the logarithms over networks of ``n`` neurons, shape (networks,), of all seeds and sizes.
    """
    fit: Any = stats.linregress(np.log(n), np.log(ratio))
    freedom = len(n) - 2
    half = float(stats.t.ppf(0.975, freedom) * fit.stderr)
    p = 2 * stats.t.sf(abs(fit.slope - 1.0) / fit.stderr, freedom)
    return float(fit.slope), half, float(p)


def _one_learner(
    problem: Pendulum | Swimming, n: int, output_scaling: bool, seed: int, moments: Sequence[int]
) -> Iterator[tuple[str | float, ...]]:
    network = Cascade(problem.n_inputs, n, generator=torch.Generator().manual_seed(seed))
    eta = ETA if output_scaling else ETA / n**0.5
    learner = FusedTD(problem, network, TDSettings(eta=eta, output_scaling=output_scaling))
    meter = NoiseMeter(learner)
    rng = np.random.default_rng(seed)
    sample = problem.initial_states(np.random.default_rng(1), 256)
    done = 0
    for trial in moments:
        meter.train(problem.initial_states(rng, trial - done))
        done = trial
        summary = noise_summary(
            meter.variance.double().numpy(), meter.mean.double().numpy(), problem.n_inputs
        )
        value = float(learner.sample(sample).value.mean())
        yield (problem.name, n, int(output_scaling), seed, trial, *summary, value)


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    pendulum_seeds: Sequence[int] = range(8),
    swimmer_seeds: Sequence[int] = range(8),
    pendulum_neurons: Sequence[int] = PENDULUM_NEURONS,
    swimmer_neurons: Sequence[int] = SWIMMER_NEURONS,
    pendulum_moments: Sequence[int] = PENDULUM_MOMENTS,
    swimmer_moments: Sequence[int] = SWIMMER_MOMENTS,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Measure, and write :data:`LOG` in ``directory``. About 45 minutes on one core."""
    rows: list[tuple[str | float, ...]] = []
    plan = (
        (Pendulum(), pendulum_seeds, pendulum_neurons, pendulum_moments, (True, False)),
        (Swimming(), swimmer_seeds, swimmer_neurons, swimmer_moments, (True,)),
    )
    for problem, seeds, sizes, moments, scalings in plan:
        for seed in seeds:
            for n in sizes:
                for output_scaling in scalings:
                    rows += _one_learner(problem, n, output_scaling, seed, moments)
                    name, *_, output, internal = rows[-1][:7]
                    assert isinstance(output, float)
                    assert isinstance(internal, float)
                    report(f"{name}, seed {seed}, n = {n}: ratio {output / internal:.1f}")
    write_table(Path(directory) / LOG, HEADER, rows, digits=4)
