"""Rates of stepping and learning, timed in one run, because only their ratios carry over from machine to machine."""

# pyright: reportAttributeAccessIssue=false
# mujoco takes its names from extension modules that have no stubs.

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import torch

from swimmer_mj.learning.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.fused import FusedTD
from swimmer_mj.learning.networks import Cascade
from swimmer_mj.learning.swimming import Swimming
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = ["best_rate", "run_benchmark"]


def best_rate(work: Callable[[], int], seconds: float = 3.0) -> float:
    """The highest rate (1/s) at which ``work``, which returns how much it did, ran over ``seconds`` of repetitions.

    The highest, because whatever else a machine does can only slow it down.
    """
    best = 0.0
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        done = work()
        best = max(best, done / (time.perf_counter() - start))
    return best


def _mj_step(viscous_friction_coefficient: float) -> Callable[[], int]:
    """Bare mj_step of the 5-link model, Euler, from a loop in C."""
    parameters = SwimmerParameters(viscous_friction=viscous_friction_coefficient)
    model = mujoco.MjModel.from_xml_string(mjcf(parameters, integrator="Euler"))
    data = mujoco.MjData(model)

    def work(steps: int = 20_000) -> int:
        mujoco.mj_resetData(model, data)
        data.qvel[:] = 0.1
        mujoco.mj_step(model, data, nstep=steps)
        return steps

    return work


def _fused(seed: int) -> Callable[[], int]:
    problem = Swimming(PAPER)
    network = Cascade(problem.n_inputs, generator=torch.Generator().manual_seed(seed))
    learner = FusedTD(problem, network, TDSettings(eta=0.01))
    rng = np.random.default_rng(seed)

    def work(trials: int = 40) -> int:
        learner.train(problem.initial_states(rng, trials))
        return trials * learner.settings.steps_per_trial

    work(1)  # compiled now
    return work


def _reference() -> Callable[[], int]:
    problem = Swimming(PAPER)
    network = Cascade(problem.n_inputs, generator=torch.Generator().manual_seed(0))
    learner = ContinuousTD(problem, network, TDSettings(eta=0.01))
    x = problem.initial_states(np.random.default_rng(0), 1)[0]

    def work(steps: int = 100) -> int:
        y = x
        for _ in range(steps):
            y = problem.step(y, learner.learn_at(y).control, learner.settings.dt)
        return steps

    return work


def run_benchmark() -> dict[str, float]:
    """Steps per second.

    Returns
    -------
    dict
        ``mj_step_per_s``: bare mj_step of the 5-link model without friction, Euler.
        ``mj_step_viscous_per_s``: the same with the compiled viscous friction.
        ``learner_steps_per_s``: full online learning steps of one learner on one core.
        ``learner_steps_per_s_total``: of as many learners as there are cores, together.
        ``reference_steps_per_s``: of the torch reference.
    """
    torch.set_num_threads(1)
    cores = os.cpu_count() or 1
    rates = {"mj_step_per_s": best_rate(_mj_step(0.0))}
    with viscous_friction():
        rates["mj_step_viscous_per_s"] = best_rate(_mj_step(PAPER.viscous_friction))
    learners = [_fused(seed) for seed in range(cores)]
    rates["learner_steps_per_s"] = best_rate(learners[0])
    with ThreadPoolExecutor(cores) as pool:
        rates["learner_steps_per_s_total"] = best_rate(
            lambda: sum(pool.map(lambda work: work(), learners)), seconds=4.0
        )
    rates["reference_steps_per_s"] = best_rate(_reference())
    return rates
