"""What does a round of learning a MuJoCo model spend its time on?

    python benchmarks/round_cost.py

Some tasks of docs/any-model.md, learned by their own settings, one thread. The parts of a round are timed inside of it:
V and its slope, the choice of controls, MuJoCo's steps, the reward and its slope, the costates through MuJoCo's
finite differences, and what is left, which is the fit. Of several rounds, each part's median counts. Prints a table and
writes benchmarks/results/round-cost.json.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from rich.console import Console
from rich.table import Table
from swimmer_as_mjcf import start, swimmer

from swimmer_mj.cli.training import changed, configured
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.method import ValueGradients

OUT = Path(__file__).parent / "results" / "round-cost.json"
MJCF = "swim5 as MJCF"
TASKS = (
    MJCF,
    "dm_control/cartpole/swingup",
    "dm_control/acrobot/swingup",
    "gymnasium/Swimmer-v5",
    "dm_control/swimmer/swimmer6",
    "dm_control/swimmer/swimmer15",
)
PARTS = ("V and its slope", "controls", "steps", "reward", "costates", "fit")


class Stopwatch:
    """Seconds spent in functions; one that is called by another that is timed too is not counted there."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._inside: list[float] = []

    def timed(self, method: Callable[..., Any], part: str) -> Callable[..., Any]:
        """The same, timed."""

        def run(*arguments: Any, **named: Any) -> Any:
            self._inside.append(0.0)
            started = time.perf_counter()
            result = method(*arguments, **named)
            took = time.perf_counter() - started
            self.spent[part] += took - self._inside.pop()
            if self._inside:
                self._inside[-1] += took
            return result

        return run

    def time(self, thing: Any, name: str, part: str) -> None:
        """From now on, that method of that object."""
        setattr(thing, name, self.timed(getattr(thing, name), part))


def learner_of(task: str) -> ValueGradientLearner[Any]:
    """As any_model.py and swimmer_as_mjcf.py have it."""
    if task == MJCF:
        return start(swimmer("actuators"), 0)
    config = changed(configured(task, "value-gradient", {}, 1), ("threads=1",))
    assert isinstance(config.method, ValueGradients)
    return config.method.start(config.problem, 0).learner


def parts(task: str, rounds: int) -> dict[str, float]:
    """Milliseconds of a round in each part, and how many states it has."""
    learner, watch = learner_of(task), Stopwatch()
    engine = learner._engine  # no other way leads inside a round
    watch.time(learner, "step", "fit")
    watch.time(engine, "judge", "V and its slope")
    form = engine.form
    batch = form.targets.__self__
    for name, part in (("_chosen", "controls"), ("_move", "steps"), ("_slopes", "reward")):
        watch.time(batch, name, part)
    engine.form = form._replace(
        targets=watch.timed(form.targets, "costates"), reward=watch.timed(form.reward, "reward")
    )
    found: list[list[float]] = []
    for _ in range(rounds + 2):
        watch.spent.clear()
        learner.step()
        found.append([1000 * watch.spent[part] for part in PARTS])
    median = np.median(found[2:], axis=0)  # the first ones compile, and begin
    return {**dict(zip(PARTS, median.tolist(), strict=True)), "states": learner.settings.steps_per_round}


def main(tasks: tuple[str, ...] = TASKS, rounds: int = 8, out: Path = OUT) -> None:
    """Print the table and write the log.

    Args:
        tasks: Which, by name.
        rounds: Of each.
        out: JSON.
    """
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    torch.set_num_threads(1)
    table = Table("task", "ms a round", *PARTS)
    rows = {}
    for task in tasks:
        rows[task] = found = parts(task, rounds)
        whole = sum(found[part] for part in PARTS)
        table.add_row(task, f"{whole:.0f}", *(f"{100 * found[part] / whole:.0f} %" for part in PARTS))
    Console().print(table)
    with replacing(out) as partial:
        partial.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
