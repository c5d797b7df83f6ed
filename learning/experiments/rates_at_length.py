"""Section 3.4's four ways to set the rates once more, with 60 neurons and for as long as it takes to swim.

:mod:`~swimmer_mj.learning.experiments.section_3_4` ends after 12,000 trials, when learning to swim has begun. Here each
method learns for 200,000, eight seeds each, with its own best setting of a sweep on other seeds: eta, of vario-eta
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
from swimmer_mj.learning.experiments.tables import LOGS, Path, write_table
from swimmer_mj.learning.problems.swim import Swimming

__all__ = ["LEARNING_LOG", "STARTS", "SWEEP_LOG", "TASK", "run", "starts"]

LEARNING_LOG = "rates-at-length.csv"
SWEEP_LOG = "rates-at-length-sweep.csv"

STARTS = (1.0, 10_000.0)
"""v(0) that are tried beside the task's own."""
TASK = Task(
    Swimming(),
    neurons=60,
    initial_variance=100.0,
    largest_value=2.5,
    trials=200_000,
    sweep_trials=30_000,
    every=10_000,
    noise_every=200_000,
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


def with_start(task: Task, rows: Sequence[Row]) -> list[Row]:
    """``rows`` of a sweep with the v(0) that they are of, as a first column."""
    return [(task.initial_variance, *row) for row in rows]


def starts(task: Task, rows: Sequence[Row], values: Sequence[float]) -> tuple[list[Task], Candidate]:
    """``task`` with each of other v(0), and vario-eta alone to be tried, by its best setting so far."""
    chosen = best(rows)["vario-eta"]
    return [replace(task, initial_variance=value, candidates=(chosen,)) for value in values], chosen


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    task: Task = TASK,
    values: Sequence[float] = STARTS,
    seeds: Sequence[int] = range(8),
    sweep_seeds: Sequence[int] = (100, 101),
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Sweep, compare, and write both logs in ``directory``. About 100 minutes on one core."""
    rows = sweep(task, sweep_seeds, report)
    logged = with_start(task, rows)
    others, chosen = starts(task, rows, values)
    scores = {task.initial_variance: score(rows, chosen)}
    for other in others:
        more = sweep(other, sweep_seeds, report)
        logged += with_start(other, more)
        scores[other.initial_variance] = score(more, chosen)
    task = replace(task, initial_variance=max(scores, key=lambda value: scores[value]))
    report(f"{', '.join(map(str, best(rows).values()))}, v(0) {task.initial_variance:g}")
    write_table(Path(directory) / SWEEP_LOG, ("initial_variance", *SWEEP_HEADER), logged, digits=4)
    found = compare(task, list(best(rows).values()), seeds, report)
    write_table(Path(directory) / LEARNING_LOG, CURVE_HEADER, found.learning, digits=4)


def score(rows: Sequence[Row], candidate: Candidate) -> float:
    """Mean reward of ``candidate`` in a sweep, over its seeds; of one that diverged, none."""
    of = [row for row in rows if tuple(row[1:4]) == candidate]
    return -float("inf") if any(row[7] for row in of) else sum(float(row[6]) for row in of) / len(of)
