"""How smooth are the tasks of docs/any-model.md, and by which settings are they learned?

    python benchmarks/task_settings.py

writes benchmarks/results/task-settings.csv, a row a task: the share of states, drawn and reached by random controls, at
which a constraint is active (a contact, a joint limit), the shortness factor, the environment's control step, and what
``train --method value-gradient`` changes of the learner's settings. Needs the extra ``gymnasium``.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import tyro
from any_model import TASKS

from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.learning.problems.mujoco.task import MujocoTask

OUT = Path(__file__).parent / "results" / "task-settings.csv"
COLUMNS = ("task", "constrained_share", "s_gamma", "control_timestep", "settings")


def main(tasks: tuple[str, ...] = TASKS, out: Path = OUT) -> None:
    """Ask each task.

    Args:
        tasks: Which, by name.
        out: CSV.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    rows: list[tuple[str | float, ...]] = []
    for name in tasks:
        task = MujocoTask(name, threads=1)
        problem = task.problem
        settings = json.dumps(dict(task.advice))
        rows.append((name, problem.constrained_share(), task.s_gamma, problem.control_timestep, settings))
        print(*rows[-1], flush=True)
    write_table(out, COLUMNS, rows)
    note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
