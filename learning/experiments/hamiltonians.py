"""H both ways: dV/dx . f as equation 2 prints it, and (V(x(t + dt)) - V(x(t))) / dt along the trajectory.

A 60-neuron cascade learns to swim (5 links, eta 0.04, 20,000 trials). Then its greedy policy swims in Euler steps
of several dt, 1 s from each of 32 states, after 5 s of swimming that are not looked at; at every step both forms of
H are taken in float64. A step counts as switching where the greedy control at its end differs from the control held
during it.

The effect on learning is measured where both forms can be learned with: normalised radial basis functions on the
pendulum (15 x 15, eta 10).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.experiments.linear_approximators import radial_basis
from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.networks.networks import Cascade, ValueNetwork
from swimmer_mj.learning.networks.policy import greedy_control, hamiltonian
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.hamiltonian import hamiltonian_by_difference, second_order_term, switches
from swimmer_mj.learning.td.linear import LinearTD

__all__ = ["DT_LOG", "EPISODE_LOG", "LEARNING_LOG", "BothHamiltonians", "both_hamiltonians", "run"]

Array = NDArray[np.float64]

DT_LOG = "hamiltonian.csv"
EPISODE_LOG = "hamiltonian-episode.csv"
LEARNING_LOG = "hamiltonian-learning.csv"

SEED = 1
TRIALS = 20_000
N_EPISODES = 32
SETTLING_TIME = 5.0
DURATION = 1.0
TIME_STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005)
EPISODE_DT = 0.01
"""Step of the episode that is logged, s."""
LEARNING_MOMENTS = (25, 50, 100, 200, 400)
PENDULUM_ETA = 10.0
"""Of the radial basis functions."""


class BothHamiltonians(NamedTuple):
    """Along Euler trajectories, shape (steps, episodes)."""

    gradient: Array
    """r - s_gamma V + dV/dx . f."""
    difference: Array
    """r - s_gamma V + (V(x + f dt) - V(x)) / dt."""
    second_order: Array
    """What the difference should add, by the slope at both ends of the step."""
    switched: Array
    """Components of the greedy control that differ between the ends of the step."""
    returned: Array
    """Components that differ now and had differed in the step before: chattering."""
    final_states: Array
    """(episodes, p)."""


def both_hamiltonians(
    problem: ControlProblem, network: ValueNetwork, states: Array, dt: float, n_steps: int
) -> BothHamiltonians:
    """Follow the greedy policy from ``states`` (episodes, p) by Euler steps and take H both ways."""

    def judge(x: Array) -> tuple[Array, Array, Array, Array]:
        """V, dV/dx, f and u."""
        state = torch.tensor(x, requires_grad=True)
        V = network(problem.inputs(state))
        (slope,) = torch.autograd.grad(V.sum(), state)
        a, B = problem.drift_and_control_matrix(x)
        u = greedy_control(B, slope.numpy(), problem.control_limits)
        return V.detach().numpy(), slope.numpy(), a + np.einsum("...pq,...q->...p", B, u), u

    x = np.array(states, dtype=np.float64)
    V, dVdx, f, u = judge(x)
    changed_before = np.zeros(u.shape, dtype=bool)
    rows = []
    for _ in range(n_steps):
        r = problem.reward(x)
        H = hamiltonian(r, V, dVdx, f, problem.s_gamma)
        x = x + dt * f
        V_next, dVdx_next, f_next, u_next = judge(x)
        H_difference = hamiltonian_by_difference(r, V, V_next, problem.s_gamma, dt)
        bend = second_order_term(dVdx, dVdx_next, f)
        returned = ((u != u_next) & changed_before).sum(axis=-1)
        rows.append((H, H_difference, bend, switches(u, u_next), returned))
        changed_before = u != u_next
        V, dVdx, f, u = V_next, dVdx_next, f_next, u_next
    gradient, difference, bend, switched, returned = (np.array(column) for column in zip(*rows, strict=True))
    return BothHamiltonians(gradient, difference, bend, switched, returned, x)


def _statistics(both: BothHamiltonians) -> tuple[float, ...]:
    """Columns of :data:`DT_LOG` after dt."""
    excess = both.gradient - both.difference
    switching = both.switched > 0
    n_switches = both.switched.sum()

    def mean(values: Array) -> float:
        return float(values.mean()) if values.size else np.nan

    return (
        mean(switching.astype(float)),
        float(both.returned.sum() / n_switches) if n_switches else np.nan,
        mean(excess),
        mean(excess[switching]),
        mean(excess[~switching]),
        mean(excess**2) ** 0.5,
        mean(excess[switching] ** 2) ** 0.5,
        mean(excess[~switching] ** 2) ** 0.5,
        float((excess[switching] ** 2).sum() / (excess**2).sum()),
        mean((excess + both.second_order) ** 2) ** 0.5,
        mean(both.gradient**2) ** 0.5,
        mean(both.difference**2) ** 0.5,
        mean(both.gradient),
        mean(both.difference),
    )


DT_HEADER = (
    "dt",
    "switching",  # fraction of steps with a switch
    "chatter",  # fraction of switches of a component that had also switched in the step before
    "mean_excess",  # of H by dV/dx . f over H by difference: all steps
    "mean_excess_switching",
    "mean_excess_other",
    "rms_excess",
    "rms_excess_switching",
    "rms_excess_other",
    "share_switching",  # share of the summed squared excess in switching steps
    "rms_unexplained",  # excess that the second-order term leaves
    "rms_gradient",  # of H itself
    "rms_difference",
    "mean_gradient",
    "mean_difference",
)


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    trials: int = TRIALS,
    time_steps: Sequence[float] = TIME_STEPS,
    learning_seeds: Sequence[int] = range(8),
    learning_moments: Sequence[int] = LEARNING_MOMENTS,
    settling_time: float = SETTLING_TIME,
    duration: float = DURATION,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Learn, swim, measure and write the three logs. About 5 minutes on one core."""
    problem = Swimming()
    network = Cascade(problem.n_inputs, 60, generator=torch.Generator().manual_seed(SEED))
    learner = FusedTD(problem, network, TDSettings(eta=0.04))
    learner.train(problem.initial_states(np.random.default_rng(SEED), trials))
    starts = problem.initial_states(np.random.default_rng(0), N_EPISODES)
    speed = learner.rollout(starts, 20.0, skip=10.0).reward.mean()
    report(f"{trials} trials: {speed:.3f} m/s")
    double = network.double()

    swimming = both_hamiltonians(problem, double, starts, 0.01, round(settling_time / 0.01)).final_states
    rows = []
    episode_rows: list[tuple[float, ...]] = []
    for dt in time_steps:
        both = both_hamiltonians(problem, double, swimming, dt, round(duration / dt))
        rows.append((dt, *_statistics(both)))
        report(f"dt = {dt}: rms of the excess {rows[-1][6]:.4f} m/s")
        if dt == EPISODE_DT:
            episode = zip(both.gradient[:, 0], both.difference[:, 0], both.switched[:, 0], strict=True)
            episode_rows = [(dt * k, *row) for k, row in enumerate(episode)]
    write_table(Path(directory) / DT_LOG, DT_HEADER, rows, digits=5)
    header = ("time", "gradient", "difference", "switched")
    write_table(Path(directory) / EPISODE_LOG, header, episode_rows, digits=5)
    _learning(directory, learning_seeds, learning_moments, report)


def _learning(
    directory: str | os.PathLike[str],
    seeds: Sequence[int],
    moments: Sequence[int],
    report: Callable[[str], None],
) -> None:
    problem = Pendulum()
    states = problem.initial_states(np.random.default_rng(1), 32)
    rows: list[tuple[str | float, ...]] = []
    for form in ("gradient", "difference"):
        for seed in seeds:
            learner = LinearTD(problem, radial_basis(), TDSettings(eta=PENDULUM_ETA), form)
            rng = np.random.default_rng(seed)
            done = 0
            for trial in moments:
                learner.train(problem.initial_states(rng, trial - done))
                done = trial
                rollout = learner.rollout(states, 10.0, skip=5.0)
                sample = learner.sample(states)
                bias = float((sample.value - rollout.discounted_return).mean())
                rows.append((form, seed, trial, float(rollout.reward.mean()), bias))
            report(
                f"pendulum, H by {form}, seed {seed}: reward {rows[-1][3]:.3f}, bias of V {rows[-1][4]:+.3f}"
            )
    write_table(Path(directory) / LEARNING_LOG, ("form", "seed", "trial", "reward", "bias"), rows, digits=5)
