"""The swimmer's task as what a policy is judged by, drawn in, and may learn in; policies as its agents.

Swimming speed has one meaning in this project: in the dm_control environment (MuJoCo, RK4 at 0.01 s, control held for
0.01 s), from the 64 initial states of seed 0, the mean velocity of the centre of mass along the target direction over
the last 10 of 20 seconds. Some gaits are still gaining speed then: steady speed is the mean over seconds 30 to 60. And
the paper's trials end after 5 s: the mean over the first 5.

Episodes are simulated by MuJoCo alone (:mod:`swimmer_mj.environments.swimming`), those of an evaluation together by
``mujoco.batch``: so they are the same where dm_control cannot be installed. A test holds them equal to episodes that
are stepped by dm_control.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.initial_states import random_initial_state
from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.problems.forms import (
    BatchPolicy,
    EnvironmentForm,
    Learner,
    Moment,
    Policy,
    Score,
    SwimmerForm,
    TrialsForm,
)
from swimmer_mj.learning.problems.problem import (
    DT,
    EPISODE_DURATION,
    N_EPISODES,
    SETTLING_TIME,
    discount_shares,
    episode_steps,
)
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.trajectory import Trajectory

__all__ = [
    "SPEED",
    "STEADY",
    "TRIAL",
    "SwimmingPolicy",
    "SwimmingSpeed",
    "distances",
    "drawn",
    "evaluate_swimming",
    "evaluation_states",
    "judged",
    "learn_in_environment",
    "learned",
    "mean_speed",
    "observed_state",
    "record_episode",
]

Array = NDArray[np.float64]
Agent = Callable[[Mapping[str, Any]], Array]

SPEED = (SETTLING_TIME, EPISODE_DURATION)
"""From when to when swimming speed is measured, s."""
STEADY = (30.0, 60.0)
"""Steady speed."""
TRIAL = (0.0, 5.0)
"""The speed of a trial of the paper."""


# What the problem offers ------------------------------------------------------------------------------------------


def judged(problem: Swimming) -> EnvironmentForm:
    """Swimming speed; with it steady speed, the speed of the paper's trials, and the return of equation 1."""
    parameters = problem.parameters
    starts = partial(evaluation_states, parameters.n_links)

    def evaluate(policy: Policy, n_episodes: int, workers: int) -> Array:
        agent = SwimmingPolicy(policy, batches=True)
        return evaluate_swimming(agent, parameters, n_episodes=n_episodes, workers=workers).speeds

    def scores(policy: Policy, n_episodes: int, workers: int) -> list[Score]:
        agent = SwimmingPolicy(policy, batches=True)
        travelled = distances(agent, parameters, starts(n_episodes), STEADY[1], workers)
        shares = discount_shares(problem.s_gamma, STEADY[1], DT) / DT
        return [
            Score("speed", "m/s", mean_speed(travelled, *SPEED)),
            Score("steady_speed", "m/s", mean_speed(travelled, *STEADY)),
            Score("first_5s_speed", "m/s", mean_speed(travelled, *TRIAL)),
            Score("discounted_return", "m", shares @ np.diff(travelled, axis=0)),
        ]

    return EnvironmentForm("speed", "m/s", starts, evaluate, scores)


def drawn(problem: Swimming) -> SwimmerForm:
    """An episode in which the target direction is reversed after 5/13 of it, as in figure 3."""

    def record(policy: Policy, duration: float) -> Trajectory:
        reversal = duration * 5 / 13
        start = evaluation_states(problem.parameters.n_links)[0]
        turn: Callable[[float], float] = lambda now: 0.0 if now < reversal - 1e-9 else math.pi  # noqa: E731
        return record_episode(policy, problem.parameters, start, duration, turn)

    return SwimmerForm(problem.parameters, record)


def learned(problem: Swimming) -> TrialsForm:
    """Trials in the environment."""
    return TrialsForm(partial(learn_in_environment, problem.parameters))


# Policies as agents -----------------------------------------------------------------------------------------------


def observed_state(observation: Mapping[str, ArrayLike]) -> Array:
    """The reduced state, in the target's frame, that a swim or steer task observes."""
    return st.join_reduced(observation["angles"], observation["angular_velocities"], observation["velocity"])


class SwimmingPolicy:
    """A policy as an agent: observation of a swim or steer task -> action in [-1, 1].

    Parameters
    ----------
    policy : Policy
        What acts.
    batches : bool
        Whether there will be many batches of observations, and nothing else: then its fastest way to act is taken.
    """

    def __init__(self, policy: Policy, batches: bool = False) -> None:
        self.policy = policy
        self._act = policy.acting() if batches and isinstance(policy, BatchPolicy) else policy

    def __call__(self, observation: Mapping[str, ArrayLike]) -> Array:
        """Action, shape (..., n - 1)."""
        x, problem = observed_state(observation), self.policy.problem
        if x.shape[-1] != problem.state_size:
            raise ValueError(
                f"observation must be that of {problem.name!r}, angles of shape (..., {problem.state_size // 2 - 1}), "
                f"got {np.shape(observation['angles'])}; take a policy of as many links"
            )
        return self._act(x) / problem.control_limits


# Learning, judging, recording -------------------------------------------------------------------------------------


def learn_in_environment(
    parameters: SwimmerParameters, learner: Learner, states: Array, duration: float, dt: float
) -> list[Moment]:
    """One trial from each of ``states`` in the environment itself, learning from its observations."""
    from swimmer_mj.environments.swimming import Environment  # MuJoCo, when it is needed

    n_steps, n_sub_steps = math.ceil(duration / dt - 1e-9), round(dt / DT)
    if n_sub_steps < 1 or abs(n_sub_steps * DT - dt) > 1e-8:
        raise ValueError(f"in MuJoCo a control is held for a multiple of {DT} s, not for {dt} s")
    remaining = iter(states)
    environment = Environment(parameters, n_sub_steps=n_sub_steps, initial_states=lambda _: next(remaining))
    moments = []
    for _ in range(len(states)):
        observation = environment.reset()
        learner.start_trial()
        for _ in range(n_steps):
            moments.append(learner.learn_at(observed_state(observation)))
            observation, _ = environment.step(moments[-1].control / parameters.torque_limits)
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
    """95 % interval of the mean over episodes, m/s; nan for a single episode."""


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
        Threads that share the episodes. The numbers are the same, however many there are.
    """
    states = evaluation_states(parameters.n_links, n_episodes)
    speeds = mean_speed(distances(agent, parameters, states, EPISODE_DURATION, workers), *SPEED)
    return SwimmingSpeed(speeds, *mean_and_interval(speeds))


def mean_speed(travelled: Array, start: float, end: float) -> Array:
    """Mean velocity along x from ``start`` to ``end`` (s), shape (episodes,), of what :func:`distances` gives."""
    last, first = episode_steps(end, start, DT)
    return (travelled[last] - travelled[first]) / (end - start)


def distances(
    agent: Agent, parameters: SwimmerParameters, states: Array, duration: float, workers: int = 1
) -> Array:
    """How far the centre of mass has come along x, the target direction; shape (steps + 1, episodes), m.

    In an episode from each of ``states``, (episodes, 2n + 2), at the start and after each step of 0.01 s.
    """
    import mujoco  # when they are needed
    from mujoco.batch import Batch

    from swimmer_mj.dynamics import from_qpos_qvel
    from swimmer_mj.environments.swimming import Environment, wrap_angle

    everything = mujoco.mjtState.mjSTATE_INTEGRATION
    remaining = iter(states)
    environment = Environment(parameters, initial_states=lambda _: next(remaining))
    physics = environment.physics  # holds the friction
    batch = Batch(physics.model, len(states), workers)
    for row in batch.state:
        environment.reset()
        mujoco.mj_getState(physics.model, physics.data, row, everything)
    n_steps, _ = episode_steps(duration, 0.0, DT)
    travelled = np.empty((n_steps + 1, len(states)))
    for t in range(n_steps + 1):
        x = from_qpos_qvel(batch.qpos, batch.qvel)
        travelled[t] = st.center_of_mass(parameters, x)[:, 0]
        if t < n_steps:
            z = st.split_reduced(st.reduce(parameters, x), parameters.n_links)
            batch.ctrl = agent({**z._asdict(), "angles": wrap_angle(z.angles)})
            batch.step(None)
    failed = batch.warning.any()
    del batch
    physics.free()
    if failed:
        raise FloatingPointError("an episode left what MuJoCo can simulate: it raised warnings")
    return travelled


def record_episode(
    policy: Policy,
    parameters: SwimmerParameters,
    initial_state: Array,
    duration: float = EPISODE_DURATION,
    target_direction: Callable[[float], float] = lambda time: 0.0,
) -> Trajectory:
    """One episode of a policy in the environment, with V and H along it.

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
    from swimmer_mj.environments.swimming import Environment  # MuJoCo, when it is needed

    n = parameters.n_links
    environment = Environment(parameters, initial_states=lambda _: initial_state)
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
