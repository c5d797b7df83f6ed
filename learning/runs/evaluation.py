"""How good is a policy, and how good is V: measured, not learned.

Swimming speed has one meaning in this project: in the dm_control environment (MuJoCo, RK4 at 0.01 s, control held for
0.01 s), from the 64 initial states of seed 0, the mean velocity of the centre of mass along the target direction over
the last 10 of 20 seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swimmer_mj import state as st
from swimmer_mj.environments import suite
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.trajectory import Trajectory

__all__ = [
    "EPISODE_DURATION",
    "N_EPISODES",
    "SETTLING_TIME",
    "SwimmingSpeed",
    "evaluate_swimming",
    "evaluation_states",
    "known_interval",
    "mean_and_interval",
    "mean_and_interval_text",
    "monte_carlo_value",
    "record_episode",
]

Array = NDArray[np.float64]
Agent = Callable[[Mapping[str, Any]], Array]

N_EPISODES = 64
"""Episodes in an evaluation."""
EPISODE_DURATION = 20.0
"""Length of each, s."""
SETTLING_TIME = 10.0
"""How much of each is left out, s: the start from a random state is not swimming."""


class SwimmingSpeed(NamedTuple):
    """Result of :func:`evaluate_swimming`."""

    speeds: Array
    """Of each episode, shape (episodes,), m/s."""
    mean: float
    """m/s."""
    ci95: tuple[float, float]
    """Bootstrap 95 % interval (BCa) of the mean over episodes, m/s; nan for a single episode."""


def evaluation_states(n_links: int, count: int = N_EPISODES) -> Array:
    """The reduced initial states of an evaluation: those of seed 0; shape (count, 2n + 2)."""
    return random_initial_state(np.random.default_rng(0), n_links, size=count)


def mean_and_interval(values: Array) -> tuple[float, tuple[float, float]]:
    """Mean and its bootstrap 95 % interval (BCa, 10,000 resamples of fixed seed), which is nan for a single value."""
    mean = float(values.mean())
    if len(values) == 1:
        return mean, (math.nan, math.nan)
    if np.ptp(values) == 0:
        return mean, (mean, mean)
    interval = stats.bootstrap((values,), np.mean, n_resamples=9999, rng=np.random.default_rng(0))
    return mean, (float(interval.confidence_interval.low), float(interval.confidence_interval.high))


def known_interval(interval: tuple[float, float]) -> tuple[float, float] | None:
    """``interval``, or None (null in JSON) where it is unknown."""
    return None if math.isnan(interval[0]) else interval


def mean_and_interval_text(values: Array, spec: str = "z.2f") -> str:
    """Such as "1.20 [1.10, 1.31]"; of a single value, the value alone."""
    mean, interval = mean_and_interval(values)
    if known_interval(interval) is None:
        return f"{mean:{spec}}"
    low, high = interval
    return f"{mean:{spec}} [{low:{spec}}, {high:{spec}}]"


def evaluate_swimming(
    agent: Agent, parameters: SwimmerParameters, *, n_episodes: int = N_EPISODES, workers: int = 1
) -> SwimmingSpeed:
    """Swimming speed of an agent, as defined above.

    Parameters
    ----------
    agent : callable
        From a batch of observations (a mapping of arrays with a leading axis of episodes) to as many actions.
    parameters : SwimmerParameters
        The swimmer.
    n_episodes : int
        How many of the initial states to use; all 64 by definition.
    workers : int
        Processes that share the episodes. More than one needs an agent that can be pickled and, as always with
        processes that are spawned, a main module that can be imported.
    """
    states = evaluation_states(parameters.n_links, n_episodes)
    if workers == 1:
        speeds = _episode_speeds(agent, parameters, states)
    else:
        parts = np.array_split(states, min(workers, n_episodes))
        with ProcessPoolExecutor(len(parts), mp_context=get_context("spawn")) as pool:
            count = len(parts)
            speeds = np.concatenate(
                list(pool.map(_episode_speeds, [agent] * count, [parameters] * count, parts))
            )
    return SwimmingSpeed(speeds, *mean_and_interval(speeds))


def _episode_speeds(agent: Agent, parameters: SwimmerParameters, states: Array) -> Array:
    """Speed of each of the episodes that start at ``states``, which are stepped side by side."""
    remaining = iter(states)
    environments = [
        suite.swim(parameters, time_limit=EPISODE_DURATION, initial_states=lambda _: next(remaining))
        for _ in states
    ]
    steps = [environment.reset() for environment in environments]
    n_steps = round(EPISODE_DURATION / environments[0].control_timestep())
    n_settling = round(SETTLING_TIME / environments[0].control_timestep())
    rewards = np.zeros((n_steps, len(states)))
    for t in range(n_steps):
        batch = {key: np.stack([step.observation[key] for step in steps]) for key in steps[0].observation}
        actions = agent(batch)
        steps = [environment.step(a) for environment, a in zip(environments, actions, strict=True)]
        rewards[t] = [step.reward for step in steps]
    for environment in environments:
        environment.physics.free()
    return rewards[n_settling:].mean(axis=0)


def record_episode(
    policy: GreedyPolicy,
    parameters: SwimmerParameters,
    initial_state: Array,
    duration: float = EPISODE_DURATION,
    target_direction: Callable[[float], float] = lambda time: 0.0,
) -> Trajectory:
    """One episode of a policy in the dm_control environment, with V and H along it.

    Parameters
    ----------
    policy : GreedyPolicy
        For the target direction +x; it is given the state in the target's frame.
    parameters : SwimmerParameters
        The swimmer.
    initial_state : ndarray, shape (2n + 2,)
        Reduced initial state.
    duration : float
        s.
    target_direction : callable
        From time (s) to the angle to swim to (rad, from the x axis).
    """
    n = parameters.n_links
    environment = suite.swim(parameters, time_limit=duration, initial_states=lambda _: initial_state)
    environment.reset()
    physics = environment.physics
    n_steps = round(duration / environment.control_timestep())
    times, states, controls, directions, values, hamiltonians = [], [], [], [], [], []
    for t in range(n_steps + 1):
        direction = target_direction(physics.time())
        physics.set_target_direction(direction)
        z = st.split_reduced(physics.reduced_state(), n)
        judged = policy.judge(
            st.join_reduced(z.angles - direction, z.angular_velocities, st.rotate(z.velocity, -direction))
        )
        times.append(physics.time())
        states.append(physics.state_vector())
        directions.append(direction)
        values.append(judged.value)
        hamiltonians.append(judged.hamiltonian)
        if t < n_steps:
            controls.append(judged.control)
            environment.step(judged.control / parameters.torque_limits)
    physics.free()
    return Trajectory(
        parameters,
        np.array(times),
        np.array(states),
        np.array(controls),
        np.array(directions),
        np.array(values),
        np.array(hamiltonians),
    )


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
    r = problem.reward(x)
    for t in range(n_steps):
        u = policy(x)

        def f(y: Array, u: Array = u) -> Array:
            a, B = problem.drift_and_control_matrix(y)
            return a + np.einsum("...pq,...q->...p", B, u)

        x = rk4_step(f, x, dt)
        r_next = problem.reward(x)
        discount, discount_next = np.exp(-problem.s_gamma * dt * np.array([t, t + 1]))
        total += dt / 2 * (discount * r + discount_next * r_next)
        r = r_next
    return total
