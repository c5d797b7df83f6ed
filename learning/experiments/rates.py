"""Rates of stepping and learning, timed in one run, because only their ratios carry over from machine to machine."""

# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import torch

from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.population import LANES, PopulationTD
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = [
    "best_rates",
    "fused",
    "mj_step",
    "on_all_cores",
    "population",
    "reference",
    "run_benchmark",
    "swimming_learner",
    "viscous_mj_step",
]


def best_rates(works: Mapping[str, Callable[[], int]], seconds: float) -> dict[str, float]:
    """The highest rate (1/s) of each of ``works``, which return how much they did, over ``seconds`` of turns.

    The highest, because whatever else a machine does can only slow it down; in turns, because it does so for a while.
    """
    best = dict.fromkeys(works, 0.0)
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        for name, work in works.items():
            start = time.perf_counter()
            done = work()
            best[name] = max(best[name], done / (time.perf_counter() - start))
    return best


def mj_step(viscous_friction_coefficient: float, n_links: int = 5) -> Callable[[], int]:
    """Bare mj_step, Euler, from a loop in C."""
    parameters = SwimmerParameters(n_links=n_links, viscous_friction=viscous_friction_coefficient)
    model = mujoco.MjModel.from_xml_string(mjcf(parameters, integrator="Euler"))
    data = mujoco.MjData(model)

    def work(steps: int = 10_000) -> int:
        mujoco.mj_resetData(model, data)
        data.qvel[:] = 0.1
        mujoco.mj_step(model, data, nstep=steps)
        return steps

    return work


def viscous_mj_step() -> Callable[[], int]:
    """The same of the paper's swimmer, with the compiled friction."""
    steps = mj_step(PAPER.viscous_friction)

    def work() -> int:
        with viscous_friction():
            return steps()

    return work


def swimming_learner(seed: int, problem: Swimming | None = None, neurons: int = 60) -> FusedTD:
    """A learner of ``problem``, the paper's by default, with its first weights."""
    problem = Swimming(PAPER) if problem is None else problem
    network = Cascade(problem.n_inputs, neurons, generator=torch.Generator().manual_seed(seed))
    return FusedTD(problem, network, TDSettings(eta=0.01))


def fused(seed: int, problem: Swimming | None = None, neurons: int = 60) -> Callable[..., int]:
    """Work of one fused learner: a function of the number of trials; compiled when this returns."""
    learner = swimming_learner(seed, problem, neurons)
    rng = np.random.default_rng(seed)

    def work(trials: int = 20) -> int:
        learner.train(learner.problem.initial_states(rng, trials))
        return trials * learner.settings.steps_per_trial

    work(1)
    return work


def population(seed: int, problem: Swimming | None = None, neurons: int = 60) -> Callable[..., int]:
    """Likewise of a full pack of learners."""
    pack = PopulationTD([swimming_learner(LANES * seed + lane, problem, neurons) for lane in range(LANES)])
    rng = np.random.default_rng(seed)

    def work(trials: int = 3) -> int:
        states = pack.problem.initial_states(rng, trials * LANES)
        pack.train(states.reshape(trials, LANES, -1))
        return trials * LANES * pack.learners[0].settings.steps_per_trial

    work(1)
    return work


def on_all_cores(
    make: Callable[[int], Callable[[], int]], pool: ThreadPoolExecutor, cores: int
) -> Callable[[], int]:
    """As many of that work as there are cores, at once."""
    works = [make(seed) for seed in range(cores)]
    return lambda: sum(pool.map(lambda work: work(), works))


def reference() -> Callable[[], int]:
    """Work of the torch reference, in float32."""
    problem = Swimming(PAPER)
    network = Cascade(problem.n_inputs, generator=torch.Generator().manual_seed(0))
    learner = ContinuousTD(problem, network, TDSettings(eta=0.01))
    x = problem.initial_states(np.random.default_rng(0), 1)[0]

    def work(steps: int = 10) -> int:
        y = x
        for _ in range(steps):
            y = problem.step(y, learner.learn_at(y).control, learner.settings.dt)
        return steps

    return work


def run_benchmark(seconds: float = 15.0) -> dict[str, float]:
    """Steps per second, all measured in turns over ``seconds``.

    Returns
    -------
    dict
        ``mj_step_per_s``: bare mj_step of the 5-link model without friction, Euler.
        ``mj_step_viscous_per_s``: the same with the compiled viscous friction.
        ``learner_steps_per_s``: full online learning steps of one learner on one core.
        ``population_steps_per_s``: of a pack of 16 learners on one core, together.
        ``learner_steps_per_s_total``: of a pack on each core, together.
        ``reference_steps_per_s``: of the torch reference.
    """
    cores = os.cpu_count() or 1
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(cores) as pool:
            works = {
                "mj_step_per_s": mj_step(0.0),
                "mj_step_viscous_per_s": viscous_mj_step(),
                "learner_steps_per_s": fused(0),
                "population_steps_per_s": population(0),
                "learner_steps_per_s_total": on_all_cores(population, pool, cores),
                "reference_steps_per_s": reference(),
            }
            return best_rates(works, seconds)
    finally:
        torch.set_num_threads(threads)
