"""How good is what a run has learned, and how good is its V: measured, not learned."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.integrators import rk4_step
from swimmer_mj.intervals import known_interval, mean_and_interval
from swimmer_mj.learning.problems.forms import CostForm, EnvironmentForm, Policy, Score, episode_of
from swimmer_mj.learning.problems.problem import (
    ControlProblem,
    discount_shares,
    episode_shares,
)
from swimmer_mj.learning.runs.run import evaluation_sample, evaluation_starts, load_policy

__all__ = ["Episode", "evaluate_run", "monte_carlo_value", "record_episode", "scores"]

Array = NDArray[np.float64]


def scores(policy: Policy, episodes: int, workers: int = 1) -> Sequence[Score]:
    """All that is measured in the problem's environment, first what it is judged by.

    Without an environment, the mean reward rate of episodes by its equations.
    """
    problem = policy.problem
    environment = problem.form(EnvironmentForm)
    if environment is None:
        duration, skip, dt = episode_of(problem)
        shares = episode_shares(duration, skip, dt)
        values = policy.episodes(evaluation_starts(problem)[:episodes], shares, dt)
        return [Score("reward", "", values)]
    if environment.scores is None:
        return [Score(environment.measure, environment.unit, environment.evaluate(policy, episodes, workers))]
    return environment.scores(policy, episodes, workers)


def evaluate_run(
    directory: str | os.PathLike[str], which: Literal["best", "last"] = "best", episodes: int = 64
) -> dict[str, Any]:
    """The scores of a run's policy; bias and error of its V against returns, by equation 1."""
    policy, config, info = load_policy(directory, which)
    problem = config.problem
    measured = scores(policy, episodes, os.cpu_count() or 1)
    found: dict[str, Any] = {}
    for name, _, values in measured:
        found[f"{name}_mean"], interval = mean_and_interval(values)
        found[f"{name}_ci95"] = known_interval(interval)
    states = evaluation_sample(problem)
    sample = policy.judge(states)
    dt = episode_of(problem).dt
    returns = policy.episodes(states, discount_shares(problem.s_gamma, 10.0 / problem.s_gamma, dt), dt)
    return {
        "run": str(Path(directory)),
        "seed": config.seed,
        "trials": info["trial"],
        "measure": measured[0].measure,
        "unit": measured[0].unit,
        "units": {one.measure: one.unit for one in measured},
        **found,
        "n_episodes": len(measured[0].values),
        "mean_value": float(sample.value.mean()),
        "mean_squared_hamiltonian": float((sample.hamiltonian**2).mean()),
        "mean_return": float(returns.mean()),
        "value_bias": float((sample.value - returns).mean()),
        "value_rmse": float(np.sqrt(((sample.value - returns) ** 2).mean())),
    }


class Episode(NamedTuple):
    """T steps of a problem under a policy."""

    problem: ControlProblem
    times: Array
    """s, (T + 1,)."""
    states: Array
    """(T + 1, p)."""
    controls: Array
    """(T, q)."""
    rewards: Array
    """Reward rates, what the controls cost taken off, (T + 1,)."""
    values: Array
    """(T + 1,)."""
    hamiltonians: Array
    """(T + 1,)."""


def record_episode(policy: Policy, duration: float) -> Episode:
    """An episode of ``duration`` seconds from the first start of an evaluation, stepped by the problem itself."""
    problem = policy.problem
    dt = episode_of(problem).dt
    n_steps = round(duration / dt)
    x = evaluation_starts(problem)[:1]
    states, judged = [x], []
    for _ in range(n_steps + 1):
        judged.append(policy.judge(states[-1]))
        states.append(problem.step(states[-1], judged[-1].control, dt))
    states = np.concatenate(states[:-1])
    controls, values, hamiltonians = (np.concatenate(column) for column in zip(*judged, strict=True))
    times = dt * np.arange(n_steps + 1, dtype=np.float64)
    rewards = _earned(problem, states, controls)
    return Episode(problem, times, states, controls[:-1], rewards, values, hamiltonians)


def _earned(problem: ControlProblem, x: Array, u: Array) -> Array:
    """r(x), what u costs taken off, (N,), at states x (N, p) under controls u (N, q)."""
    priced, r = problem.form(CostForm), problem.reward(x)
    return r if priced is None else r - (priced.coefficients(x) * u**2).sum(axis=-1)


def monte_carlo_value(
    problem: ControlProblem,
    policy: Callable[[Array], Array],
    states: Array,
    *,
    dt: float = 0.01,
    tolerance: float = 1e-3,
) -> Array:
    """V^pi at ``states`` (count, p) by equation 1: the discounted return of a rollout from each, shape (count,).

    The dynamics are deterministic, so that one rollout is exact up to RK4 and the trapezoidal rule at ``dt`` with
    the control held, and up to the end of the rollout, where the discount has fallen to ``tolerance``.
    """
    n_steps = int(np.ceil(-np.log(tolerance) / (problem.s_gamma * dt)))
    x = np.array(states, dtype=np.float64)
    total = np.zeros(len(x))
    for t in range(n_steps):
        u = policy(x)
        r = _earned(problem, x, u)

        def f(y: Array, u: Array = u) -> Array:
            a, B = problem.drift_and_control_matrix(y)
            return a + np.einsum("...pq,...q->...p", B, u)

        x = rk4_step(f, x, dt)
        r_next = _earned(problem, x, u)
        discount, discount_next = np.exp(-problem.s_gamma * dt * np.array([t, t + 1]))
        total += dt / 2 * (discount * r + discount_next * r_next)
    return total
