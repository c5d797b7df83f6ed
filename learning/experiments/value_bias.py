"""Does V say what the policy gets? V against the Monte Carlo return of equation 1, over the state space.

At several moments of training, V_w(x) and the discounted return of the greedy policy from the same x are taken at
200 states of the law of initial states. The return is that of one rollout of 10 / s_gamma seconds (RK4, control
held for 0.01 s): the dynamics are deterministic, so that one is enough.

- bias: mean of V - return; positive where V promises too much.
- deviation: standard deviation of V - return over the states, the part of the error that a constant would not mend.
- rmse, with rmse^2 = bias^2 + deviation^2, and the correlation of V with the return.

Chosen: eta 0.04 with output scaling, s_gamma and s_lambda 1 1/s, trials of 5 s; pendulum 20 neurons, swimmer of 5
links 60.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD

__all__ = ["STATES_LOG", "TABLE_LOG", "ErrorOfValue", "run", "value_error"]

Array = NDArray[np.float64]

TABLE_LOG = "value-bias.csv"
STATES_LOG = "value-bias-states.csv"

ETA = 0.04
N_STATES = 200
PENDULUM_MOMENTS = (100, 500, 2000, 4000)
SWIMMER_MOMENTS = (500, 2000, 8000, 40_000)


class ErrorOfValue(NamedTuple):
    """How V differs from the return."""

    bias: float
    deviation: float
    rmse: float
    correlation: float


def value_error(V: Array, returns: Array) -> ErrorOfValue:
    """Bias, deviation, rmse and correlation of V, shape (states,), as an estimate of the returns, shape (states,)."""
    error = V - returns
    flat = np.ptp(V) == 0 or np.ptp(returns) == 0
    correlation = np.nan if flat else float(np.corrcoef(V, returns)[0, 1])
    return ErrorOfValue(
        float(error.mean()), float(error.std()), float(np.sqrt((error**2).mean())), correlation
    )


def _one_learner(
    problem: Pendulum | Swimming, n_neurons: int, seed: int, moments: Sequence[int], states: Array
) -> Iterator[tuple[int, Array, Array]]:
    """(trial, V, returns) at each moment."""
    network = Cascade(problem.n_inputs, n_neurons, generator=torch.Generator().manual_seed(seed))
    learner = FusedTD(problem, network, TDSettings(eta=ETA))
    rng = np.random.default_rng(seed)
    done = 0
    for trial in moments:
        learner.train(problem.initial_states(rng, trial - done))
        done = trial
        returns = learner.rollout(states, 10 / problem.s_gamma).discounted_return
        yield trial, learner.sample(states).value, returns


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    pendulum_seeds: Sequence[int] = range(8),
    swimmer_seeds: Sequence[int] = range(8),
    pendulum_moments: Sequence[int] = PENDULUM_MOMENTS,
    swimmer_moments: Sequence[int] = SWIMMER_MOMENTS,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Learn and measure; the states of the first seed are logged one by one. About 15 minutes on one core."""
    table: list[tuple[str | float, ...]] = []
    points: list[tuple[str | float, ...]] = []
    plan = (
        (Pendulum(), 20, pendulum_seeds, pendulum_moments),
        (Swimming(), 60, swimmer_seeds, swimmer_moments),
    )
    for problem, n_neurons, seeds, moments in plan:
        states = problem.initial_states(np.random.default_rng(1), N_STATES)
        for seed in seeds:
            for trial, V, returns in _one_learner(problem, n_neurons, seed, moments, states):
                error = value_error(V, returns)
                table.append((problem.name, seed, trial, *error, float(returns.mean())))
                if seed == seeds[0]:
                    points += [(problem.name, trial, v, R) for v, R in zip(V, returns, strict=True)]
                report(
                    f"{problem.name}, seed {seed}, trial {trial}: bias {error.bias:+.3f}, rmse {error.rmse:.3f}"
                )
    header = ("problem", "seed", "trial", *ErrorOfValue._fields, "mean_return")
    write_table(Path(directory) / TABLE_LOG, header, table, digits=5)
    write_table(Path(directory) / STATES_LOG, ("problem", "trial", "value", "return"), points, digits=4)
