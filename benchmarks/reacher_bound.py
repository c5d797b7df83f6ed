"""What is the most that Reacher-v5 pays? Its episodes are short and known, so that each can be planned to its end.

    python benchmarks/reacher_bound.py

For each of the thirty episodes by which benchmarks/any_model.py judges, the controls of learned policies are improved
by gradient ascent on the episode's return (costates backwards through steps of MuJoCo, Adam, controls clipped to their
range), and then played in the unmodified environment. Writes benchmarks/results/reacher-bound.csv: the return of the
best learned policy in each episode, and of the best controls found. No feedback policy is likely to do better than the
latter, which know their start beforehand; they are local optima and no proof, which is why there are several policies.
"""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import torch
import tyro
from any_model import FRESH
from numpy.typing import NDArray
from yardstick import Clock

from swimmer_mj.cli.training import configured
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.mujoco.batched import MujocoBatch
from swimmer_mj.learning.problems.mujoco.episodes import open_episode
from swimmer_mj.learning.problems.mujoco.task import MujocoTask

OUT = Path(__file__).parent / "results" / "reacher-bound.csv"
TASK = "gymnasium/Reacher-v5"
STEPS, DT = 50, 0.02
COST = 1.0
"""Of u^2 a step."""

Array = NDArray[np.float64]


def trajectory(batch: MujocoBatch, start: Array, u: Array) -> tuple[Array, Array]:
    """States (STEPS + 1, p, N) under u (STEPS, q, N), and what a unit of control adds to the next, (STEPS, q, p, N)."""
    x, gain = np.empty((STEPS + 1, *start.shape)), np.empty((STEPS, u.shape[1], *start.shape))
    x[0] = start
    for t in range(STEPS):
        x[t + 1] = batch.step(x[t], u[t], DT)
        gain[t] = batch.responses(x[t], DT, own=False)[1]
    return x, gain


def slope(batch: MujocoBatch, start: Array, u: Array) -> Array:
    """d return / du, (STEPS, q, N)."""
    x, gain = trajectory(batch, start, u)
    p, N = start.shape
    out = np.zeros((STEPS, p + 1, N))
    nothing = np.zeros((STEPS + 1, N)), np.zeros((STEPS + 1, p, N))
    batch.targets(x, u, *nothing, DT, 0.0, 0.0, out)  # no discount, and nothing but what is ahead
    costate = np.concatenate([out[1:, :p], np.zeros((1, p, N))])
    return (gain * costate[:, None]).sum(axis=2) / DT - 2 * COST * u


def improved(batch: MujocoBatch, start: Array, u: Array, iterations: int = 400) -> Array:
    """u after so many steps of Adam upwards, the last fifth of them smaller."""
    moment, square = np.zeros_like(u), np.zeros_like(u)
    for k in range(iterations):
        g = slope(batch, start, u)
        moment += 0.1 * (g - moment)
        square += 0.01 * (g**2 - square)
        rate = 0.01 if k < 0.8 * iterations else 0.002
        away = (moment / (1 - 0.9 ** (k + 1))) / (np.sqrt(square / (1 - 0.99 ** (k + 1))) + 1e-8)
        u = np.clip(u + rate * away, -1, 1)
    return u


def main(policies: int = 3, seconds: float = 15.0, out: Path = OUT) -> None:
    """Learn some policies and improve what they do.

    Args:
        policies: How many.
        seconds: Processor time of each.
        out: The table.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    torch.set_num_threads(1)
    task = MujocoTask(TASK, threads=1)
    batch = task.problem.batch()
    start = np.stack([task.state(open_episode(TASK, seed)) for seed in FRESH], axis=1)
    learned, planned = np.full(len(FRESH), -np.inf), np.full(len(FRESH), -np.inf)
    for seed in range(policies):
        learner = configured(TASK, "value-gradient", {}, 1).method.start(task, seed).learner
        learner.step()  # compiles
        clock = Clock()
        while clock.read()[0] < seconds:
            learner.step()
        policy = learner.policy()
        learned = np.maximum(learned, task.returns(policy, FRESH))
        act, x, u = policy.acting(), start, np.empty((STEPS, 2, len(FRESH)))
        for t in range(STEPS):
            u[t] = act(np.ascontiguousarray(x.T)).T
            x = batch.step(x, u[t], DT)
        u = improved(batch, start, u)
        for k, number in enumerate(FRESH):
            episode = open_episode(TASK, number)
            planned[k] = max(
                planned[k], sum(episode.step(task.problem.ctrl(u[t, :, k])) for t in range(STEPS))
            )
        print(f"{seed + 1} policies: {learned.mean():.3f} learned, {planned.mean():.3f} planned", flush=True)
    with replacing(out) as path, path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("episode", "learned", "planned"))
        writer.writerows(
            (number, f"{a:.4f}", f"{b:.4f}") for number, a, b in zip(FRESH, learned, planned, strict=True)
        )
    note_made(out)


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
