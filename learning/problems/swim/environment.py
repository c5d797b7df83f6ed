"""The dm_control task as what a policy is judged by, drawn in, and may learn in; policies as its agents.

Swimming speed has one meaning in this project: in the dm_control environment (MuJoCo, RK4 at 0.01 s, control held for
0.01 s), from the 64 initial states of seed 0, the mean velocity of the centre of mass along the target direction over
the last 10 of 20 seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.problems.forms import (
    EnvironmentForm,
    Learner,
    Moment,
    Policy,
    SwimmerForm,
    TrialsForm,
)
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, N_EPISODES, SETTLING_TIME
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.trajectory import Trajectory

__all__ = [
    "SwimmingPolicy",
    "SwimmingSpeed",
    "drawn",
    "evaluate_swimming",
    "evaluation_states",
    "judged",
    "learn_in_environment",
    "learned",
    "observed_state",
    "record_episode",
]

Array = NDArray[np.float64]
Agent = Callable[[Mapping[str, Any]], Array]


# What the problem offers ------------------------------------------------------------------------------------------


def judged(problem: Swimming) -> EnvironmentForm:
    """Swimming speed."""
    n = problem.parameters.n_links

    def evaluate(policy: Policy, n_episodes: int, workers: int) -> Array:
        agent = SwimmingPolicy(policy)
        return evaluate_swimming(agent, problem.parameters, n_episodes=n_episodes, workers=workers).speeds

    return EnvironmentForm("speed", "m/s", partial(evaluation_states, n), evaluate)


def drawn(problem: Swimming) -> SwimmerForm:
    """An episode in which the target direction is reversed after 5/13 of it, as in figure 3."""

    def record(policy: Policy, duration: float) -> Trajectory:
        reversal = duration * 5 / 13
        start = evaluation_states(problem.parameters.n_links)[0]
        turn: Callable[[float], float] = lambda now: 0.0 if now < reversal - 1e-9 else math.pi  # noqa: E731
        return record_episode(policy, problem.parameters, start, duration, turn)

    return SwimmerForm(problem.parameters, record)


def learned(problem: Swimming) -> TrialsForm:
    """Trials in dm_control."""
    return TrialsForm(partial(learn_in_environment, problem.parameters))


# Policies as agents -----------------------------------------------------------------------------------------------


def observed_state(observation: Mapping[str, ArrayLike]) -> Array:
    """The reduced state, in the target's frame, that a swim or steer task observes."""
    return st.join_reduced(observation["angles"], observation["angular_velocities"], observation["velocity"])


class SwimmingPolicy:
    """A policy as an agent: observation of a swim or steer task -> action in [-1, 1]."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def __call__(self, observation: Mapping[str, ArrayLike]) -> Array:
        """Action, shape (..., n - 1)."""
        return self.policy(observed_state(observation)) / self.policy.problem.control_limits


# Learning, judging, recording -------------------------------------------------------------------------------------


def learn_in_environment(
    parameters: SwimmerParameters, learner: Learner, states: Array, duration: float, dt: float
) -> list[Moment]:
    """One trial from each of ``states`` in the dm_control environment itself, learning from its observations."""
    from swimmer_mj.environments import suite  # dm_control, when it is needed

    remaining = iter(states)
    environment = suite.swim(
        parameters,
        time_limit=duration,
        initial_states=lambda _: next(remaining),
        environment_kwargs={"control_timestep": dt},
    )
    moments = []
    for _ in range(len(states)):
        step = environment.reset()
        learner.start_trial()
        while not step.last():
            moments.append(learner.learn_at(observed_state(step.observation)))
            step = environment.step(moments[-1].control / parameters.torque_limits)
        learner.end_trial()
    environment.physics.free()
    return moments


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
    from swimmer_mj.environments import suite  # dm_control, when it is needed

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
    policy: Policy,
    parameters: SwimmerParameters,
    initial_state: Array,
    duration: float = EPISODE_DURATION,
    target_direction: Callable[[float], float] = lambda time: 0.0,
) -> Trajectory:
    """One episode of a policy in the dm_control environment, with V and H along it.

    Parameters
    ----------
    policy : Policy
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
    from swimmer_mj.environments import suite  # dm_control, when it is needed

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
