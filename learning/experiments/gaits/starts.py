"""Where the search begins: strokes that learners swim, waves, random motions, and other gaits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.learning.experiments.gaits.gait import Gait
from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["at_speed", "learned_stroke", "random_motion", "shortest_recurrence", "wave", "with_a_link_more"]

Array = NDArray[np.float64]

SHORTEST, LONGEST = 0.4, 3.0
"""Strokes of learners that are looked for, s."""
SETTLED, RECORDED = 10.0, 20.0
"""A stroke is cut from between these times of an episode, s."""
DT = 0.01
"""s."""


def shortest_recurrence(states: Array, n_links: int) -> int:
    """After how many steps a motion comes back to where it was: the first minimum that is nearly as good as the best.

    What differs is measured by cos and sin of the angles and by the velocities, these in units of their deviation.
    """
    angles, rates = states[:, :n_links], states[:, n_links:]
    points = np.concatenate([np.cos(angles), np.sin(angles), rates / rates.std(axis=0)], axis=1)
    lags = np.arange(round(SHORTEST / DT), min(round(LONGEST / DT), len(states) // 2))
    apart = np.array([((points[lag:] - points[:-lag]) ** 2).sum(axis=1).mean() for lag in lags])
    minima = 1 + np.flatnonzero((apart[1:-1] < apart[:-2]) & (apart[1:-1] <= apart[2:]))
    if not minima.size:
        return int(lags[np.argmin(apart)])
    return int(lags[minima[apart[minima] <= 1.2 * apart[minima].min()][0]])


def learned_stroke(policy: Policy, start: int) -> Gait:
    """The last stroke of 20 s of a policy's episode, from an initial state of the evaluation."""
    problem = policy.problem
    n = (problem.state_size - 2) // 2
    z = evaluation_states(n)[start : start + 1]
    states, controls = [], []
    for _ in range(round(RECORDED / DT)):
        u = policy.judge(z).control
        states.append(z[0])
        controls.append(u[0])
        z = problem.step(z, u, DT)
    settled = round(SETTLED / DT)
    steps = shortest_recurrence(np.array(states)[settled:], n)
    part, torques = np.array(states[-steps - 1 :]), np.array(controls[-steps - 1 : -1])
    turns = np.round((part[-1, :n] - part[0, :n]) / (2 * np.pi))
    return Gait(SwimmerParameters(n_links=n), steps * DT, part[:-1], torques, turns)


def _motion(parameters: SwimmerParameters, duration: float, angles: Array, rates: Array) -> Gait:
    """Angles and their rates of a chain without torques, whose centre of mass rests."""
    N, n = angles.shape
    states = st.join_reduced(angles, rates, np.zeros((N, 2)))
    return Gait(parameters, duration, states, np.zeros((N, n - 1)), np.zeros(n))


def wave(parameters: SwimmerParameters, duration: float, lag: float, n_intervals: int) -> Gait:
    """A wave along a straight chain: theta_i = 0.6 sin(2 pi t / T - i lag)."""
    phase = 2 * np.pi * np.arange(n_intervals)[:, None] / n_intervals - lag * np.arange(parameters.n_links)
    return _motion(parameters, duration, 0.6 * np.sin(phase), 0.6 * 2 * np.pi / duration * np.cos(phase))


def random_motion(parameters: SwimmerParameters, rng: np.random.Generator, n_intervals: int) -> Gait:
    """Angles of three random harmonics about random means, T between 0.6 and 3 s."""
    n = parameters.n_links
    duration = float(rng.uniform(0.6, 3.0))
    angles = np.broadcast_to(rng.normal(0.0, 0.5, n), (n_intervals, n)).copy()
    rates = np.zeros((n_intervals, n))
    for harmonic in (1, 2, 3):
        amplitude = rng.normal(0.0, 0.8 / harmonic**2, n)
        phase = 2 * np.pi * (harmonic * np.arange(n_intervals)[:, None] / n_intervals + rng.uniform(size=n))
        angles += amplitude * np.sin(phase)
        rates += 2 * np.pi * harmonic / duration * amplitude * np.cos(phase)
    return _motion(parameters, duration, angles, rates)


def at_speed(gait: Gait, speed: float) -> Gait:
    """The same motion with another mean velocity along x."""
    states = gait.states.copy()
    states[:, -2] += speed - states[:, -2].mean()
    return Gait(gait.parameters, gait.duration, states, gait.controls, gait.turns, gait.pull)


def with_a_link_more(gait: Gait) -> Gait:
    """The same motion of a chain whose last link is drawn out by another, its joint without torque."""
    n = gait.parameters.n_links
    angles, rates, velocity = np.split(gait.states, [n, 2 * n], axis=1)
    states = np.concatenate([angles, angles[:, -1:], rates, rates[:, -1:], velocity], axis=1)
    controls = np.concatenate([gait.controls, np.zeros((gait.n_intervals, 1))], axis=1)
    turns = np.append(gait.turns, gait.turns[-1])
    return Gait(SwimmerParameters(n_links=n + 1), gait.duration, states, controls, turns, gait.pull)
