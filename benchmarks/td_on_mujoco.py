"""What does the paper's method learn of tasks of dm_control and Gymnasium, in MuJoCo, one state after the other?

    python benchmarks/td_on_mujoco.py [--tasks dm_control/pendulum/swingup ...] [--seeds 100 101 ...] [--seconds 120]

adds to benchmarks/results/td-on-mujoco.csv, a row a look: TD(lambda) with the settings that ``swimmer-mj train --method
td --problem TASK`` has, one learner on one core, judged as benchmarks/any_model.py judges value gradients. A seed that
is there already is not learned again; compilation and looks are not counted. Tasks of Gymnasium need the extra
``gymnasium``. The seeds from 100 on were used for nothing else.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import tyro
from any_model import COLUMNS, watch
from rich.console import Console
from yardstick import Row, fill

from swimmer_mj.cli.training import changed, configured
from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.mujoco.task import MujocoTask
from swimmer_mj.learning.td.method import TemporalDifferences

OUT = Path(__file__).parent / "results" / "td-on-mujoco.csv"
TASKS = ("dm_control/pendulum/swingup",)
EVERY = 10.0
"""Seconds between looks."""


def learn(
    task: str, seed: int, seconds: float, console: Console, settings: Sequence[str] = ("threads=1",)
) -> list[Row]:
    """A row for each look at one learner; ``settings`` as after ``--set``."""
    config = changed(configured(task, "td", {}, 1), settings)
    problem, method = config.problem, config.method
    assert isinstance(problem, MujocoTask)
    assert isinstance(method, TemporalDifferences)
    learning = method.start(problem, seed)
    learning.learn(1)  # compiles

    def policy() -> Policy:
        return method.policy(problem, {name: tensor.clone() for name, tensor in learning.result().items()})

    return watch(
        task,
        seed,
        problem,
        lambda: learning.learn(1),
        policy,
        lambda: learning.trials * method.settings.steps_per_trial,
        np.arange(EVERY, seconds, EVERY).tolist(),
        seconds,
        console,
    )


def main(
    tasks: tuple[str, ...] = TASKS,
    seeds: Sequence[int] = tuple(range(100, 110)),
    seconds: float = 120.0,
    out: Path = OUT,
) -> None:
    """Learn each task with each seed.

    Args:
        tasks: Which, by name.
        seeds: Of the learners.
        seconds: Processor time of each.
        out: The table that rows are added to.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    torch.set_num_threads(1)
    console = Console(highlight=False)
    keys = ((task, seed) for seed in seeds for task in tasks)
    fill(out, COLUMNS, keys, lambda task, seed: learn(task, seed, seconds, console))


if __name__ == "__main__":
    np.seterr(all="warn")
    tyro.cli(main)
