"""How well are tasks of dm_control and Gymnasium learned on MuJoCo's own derivatives, and how fast?

    python benchmarks/any_model.py [--tasks dm_control/cartpole/swingup ...] [--seeds 100 101 ...] [--seconds 300]

adds to benchmarks/results/any-model.csv, a row a look: value gradients with the settings that ``swimmer-mj train
--method value-gradient --problem TASK`` has, one learner on one core, judged by the return of ten episodes of the
unmodified environment. The weights of the best look are what a run keeps; the last row of a seed, "best", has their
return in thirty other episodes. Of swimmers, whose return depends most on where the target falls, it is twenty and two
hundred; of the double pendulum, which falls in one episode of many, fifty and thirty. A seed that is there already is
not learned again; compilation and looks are not counted. Needs the extra ``gymnasium``. The seeds from 100 on were used
for nothing else.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rich.console import Console
from yardstick import Row, fill, looks

from swimmer_mj.cli.training import changed, configured
from swimmer_mj.learning.problems.forms import Policy
from swimmer_mj.learning.problems.mujoco.task import MujocoTask
from swimmer_mj.learning.problems.mujoco.tasks import dm_control, gymnasium
from swimmer_mj.learning.value_gradient.method import ValueGradients

OUT = Path(__file__).parent / "results" / "any-model.csv"
TASKS = (
    *(f"dm_control/{name}" for name in dm_control.TASKS),
    *(f"gymnasium/{name}" for name in gymnasium.TASKS),
)
COLUMNS = (
    "task",
    "seed",
    "look",
    "cpu_seconds",
    "simulation_steps",
    "return_mean",
    "return_min",
    "return_max",
)
LOOKED_AT = range(10)
FRESH = range(1000, 1030)
AS_THE_TARGET_FALLS = "dm_control/swimmer/"
"""Tasks in which most of a return depends on how near the target happens to be."""
EPISODES_OF_A_LOOK = {
    "dm_control/swimmer/swimmer6": 20,
    "dm_control/swimmer/swimmer15": 20,
    "gymnasium/InvertedDoublePendulum-v5": 50,  # ten do not tell a policy that never falls from one that seldom does
}
"""Where ten are too few."""
LOOKS = (5.0, 7.5, 11.0, 17.0, 25.0, *np.arange(40.0, 1200.0, 20.0).tolist())  # s


def looked_at(task: str) -> range:
    """Episodes of the looks."""
    return range(EPISODES_OF_A_LOOK.get(task, len(LOOKED_AT)))


def looks_at(task: str) -> tuple[float, ...]:
    """Processor time of the looks, s; fewer where each takes long."""
    return LOOKS[:8] + LOOKS[8::4] if task.startswith(AS_THE_TARGET_FALLS) else LOOKS


def fresh(task: str) -> range:
    """Episodes of the judgement."""
    return range(1000, 1200) if task.startswith(AS_THE_TARGET_FALLS) else FRESH


def watch(
    task: str,
    seed: int,
    problem: MujocoTask,
    step: Callable[[], object],
    policy: Callable[[], Policy],
    simulated: Callable[[], int],
    times: Sequence[float],
    seconds: float,
    console: Console,
) -> list[Row]:
    """A row for each look at one learner while it learns by ``step``, and one for what its best look kept."""
    rows: list[Row] = []
    best, best_return, best_time = policy(), -np.inf, 0.0

    def row(look: str, at: float, returns: NDArray[np.float64]) -> None:
        numbers = (f"{value:.4f}" for value in (returns.mean(), returns.min(), returns.max()))
        rows.append((task, seed, look, f"{at:.1f}", simulated(), *numbers))
        console.print(*rows[-1])

    for clock in looks(step, times, seconds):
        at, now = clock.before[0], policy()
        returns = problem.returns(now, looked_at(task))
        row("of the learner", at, returns)
        if returns.mean() > best_return:
            best, best_return, best_time = now, returns.mean(), at
    row("best", best_time, problem.returns(best, fresh(task)))
    return rows


def learn(
    task: str, seed: int, seconds: float, console: Console, settings: Sequence[str] = ("threads=1",)
) -> list[Row]:
    """A row for each look at one learner; ``settings`` as after ``--set``."""
    config = changed(configured(task, "value-gradient", {}, 1), settings)
    problem, method = config.problem, config.method
    assert isinstance(problem, MujocoTask)
    assert isinstance(method, ValueGradients)
    learner = method.start(problem, seed).learner
    learner.step()  # compiles
    return watch(
        task,
        seed,
        problem,
        learner.step,
        learner.policy,
        lambda: learner.simulation_steps,
        looks_at(task),
        seconds,
        console,
    )


def main(
    tasks: tuple[str, ...] = TASKS,
    seeds: Sequence[int] = tuple(range(100, 110)),
    seconds: float = 300.0,
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
