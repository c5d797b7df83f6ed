"""What does an episode earn in which nothing is done? The least that a return must be compared with.

    python benchmarks/without_control.py

adds to benchmarks/results/without-control.csv, a row a task: the mean return of the episodes by which any_model.py
judges, and of many others, with all controls in the middle of their range. Tasks that are there already are not played
again. Needs the extra ``gymnasium``.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import tyro
from any_model import TASKS, fresh
from numpy.typing import NDArray
from yardstick import append, finished

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.problems.mujoco.task import MujocoTask

OUT = Path(__file__).parent / "results" / "without-control.csv"
COLUMNS = ("task", "seed", "episodes", "return_mean", "ci95_low", "ci95_high", "of_those_judged")
OTHERS = 5000
"""Number of the first of the other episodes; the table has it as the seed."""

Array = NDArray[np.float64]


def main(tasks: tuple[str, ...] = TASKS, episodes: int = 300, out: Path = OUT) -> None:
    """Play each task.

    Args:
        tasks: Which, by name.
        episodes: How many others.
        out: The table that rows are added to.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    for name in tasks:
        if (name, str(OTHERS)) in finished(out, COLUMNS):
            continue
        task = MujocoTask(name, threads=1)

        def nothing(x: Array, q: int = len(task.control_limits)) -> Array:
            return np.zeros((len(x), q))

        returns = [
            task.returns(nothing, range(first, min(first + 50, OTHERS + episodes)))
            for first in range(OTHERS, OTHERS + episodes, 50)
        ]
        mean, (low, high) = mean_and_interval(np.concatenate(returns))
        judged = task.returns(nothing, fresh(name)).mean()
        numbers = (f"{value:.2f}" for value in (mean, low, high, judged))
        append(out, [(name, OTHERS, episodes, *numbers)])


if __name__ == "__main__":
    tyro.cli(main)
