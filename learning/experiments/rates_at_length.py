"""Section 3.4's four ways to set the rates once more, with 60 neurons and for as long as it takes to swim.

:mod:`~swimmer_mj.learning.experiments.section_3_4` ends after 12,000 trials, when learning to swim has begun. Here each
method learns for a million, eight seeds each, with its own best setting of a sweep on other seeds: eta, of vario-eta
epsilon and then v(0) as well, of Levenberg-Marquardt mu. What is best and what has diverged are told as there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from swimmer_mj.learning.experiments.section_3_4 import (
    CURVE_HEADER,
    SWEEP_HEADER,
    Candidate,
    Row,
    Task,
    best,
    compare,
    grid,
    sweep,
)
from swimmer_mj.learning.experiments.tables import LOGS, Path, read_table, rows_of, write_table
from swimmer_mj.learning.problems.swim import Swimming

__all__ = ["LEARNING_LOG", "STARTS", "SWEEP_LOG", "TASK", "run", "settings", "starts"]

LEARNING_LOG = "rates-at-length.csv"
SWEEP_LOG = "rates-at-length-sweep.csv"

STARTS = (1.0, 10_000.0)
"""v(0) that are tried beside the task's own."""
TASK = Task(
    Swimming(),
    neurons=60,
    initial_variance=100.0,
    largest_value=2.5,
    trials=1_000_000,
    sweep_trials=30_000,
    every=10_000,
    noise_every=1_000_000,
    sweep_every=10_000,
    candidates=(
        *grid("plain", (0.01, 0.02, 0.04, 0.08)),
        *grid("output scaled", (0.04, 0.08, 0.16, 0.32)),
        *grid("vario-eta", (0.0003, 0.0006, 0.001, 0.003, 0.01, 0.03), (0.0003, 0.001, 0.003, 0.01)),
        *grid("vario-eta", (0.0001,), (0.0001, 0.0003, 0.001, 0.003)),
        *grid("vario-eta", (0.0003, 0.0006, 0.001, 0.003), (0.0001,)),
        *grid("Levenberg-Marquardt", (0.001, 0.003, 0.01, 0.03), (0.003, 0.01, 0.03, 0.1)),
        *grid("Levenberg-Marquardt", (0.0003,), (0.0003, 0.001, 0.003, 0.01)),
        *grid("Levenberg-Marquardt", (0.0006,), (0.001, 0.003)),
        *grid("Levenberg-Marquardt", (0.001,), (0.0003, 0.001)),
    ),
)


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    task: Task = TASK,
    values: Sequence[float] = STARTS,
    seeds: Sequence[int] = range(8),
    sweep_seeds: Sequence[int] = (100, 101),
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Sweep, compare, and write both logs in ``directory``. About five hours on one core.

    Takes the sweep that is logged there, if one is, and goes on with the packs in ``directory``/runs.
    """
    directory = Path(directory)
    log = directory / SWEEP_LOG
    if not log.exists():
        swept = _with_start(task, sweep(task, sweep_seeds, report))
        for other in starts(task, swept, values):
            swept += _with_start(other, sweep(other, sweep_seeds, report))
        write_table(log, ("initial_variance", *SWEEP_HEADER), swept, digits=4)
    task, chosen = settings(task, rows_of(read_table(log)))
    report(f"{', '.join(map(str, chosen))}, v(0) {task.initial_variance:g}")
    found = compare(task, chosen, seeds, report, directory / "runs")
    write_table(directory / LEARNING_LOG, CURVE_HEADER, found.learning, digits=4)


def _with_start(task: Task, rows: Sequence[Row]) -> list[Row]:
    """``rows`` of a sweep with the v(0) that they are of, as a first column."""
    return [(task.initial_variance, *row) for row in rows]


def _swept_with(rows: Sequence[Row], start: float) -> list[Row]:
    """The rows of a sweep with v(0) ``start``, without it."""
    return [row[1:] for row in rows if row[0] == start]


def starts(task: Task, rows: Sequence[Row], values: Sequence[float]) -> list[Task]:
    """``task`` with each of other v(0), and vario-eta alone to be tried, by its best setting so far."""
    chosen = best(_swept_with(rows, task.initial_variance))["vario-eta"]
    return [replace(task, initial_variance=value, candidates=(chosen,)) for value in values]


def settings(task: Task, rows: Sequence[Row]) -> tuple[Task, list[Candidate]]:
    """``task`` with the best v(0) of ``rows``, and the best setting of each method."""
    chosen = best(_swept_with(rows, task.initial_variance))
    values = dict.fromkeys(float(row[0]) for row in rows)
    scores = {value: score(_swept_with(rows, value), chosen["vario-eta"]) for value in values}
    return replace(task, initial_variance=max(scores, key=lambda value: scores[value])), list(chosen.values())


def score(rows: Sequence[Row], candidate: Candidate) -> float:
    """Mean reward of ``candidate`` in a sweep, over its seeds; of one that diverged, none."""
    of = [row for row in rows if tuple(row[1:4]) == candidate]
    return -float("inf") if any(row[7] for row in of) else sum(float(row[6]) for row in of) / len(of)
