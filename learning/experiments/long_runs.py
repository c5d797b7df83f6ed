"""The long runs behind figure 2: 3, 4 and 5 links, the paper's learning rate and a larger one, eight seeds each.

And of 5 links with the state's own 12 numbers as inputs, as the paper has them: by its rate, and by a quarter of it.

    swimmer-mj figures figure-2 --rerun --out DIRECTORY

(figure-2-3-links and figure-2-4-links for the others) starts what is not there and goes on with what is, until each run
has its trials. The sixteen runs of a swimmer are one pack of :mod:`~swimmer_mj.learning.td.population`; what a run
computes depends neither on interruptions nor on the others. To use a machine's cores, run the three swimmers at once.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

from swimmer_mj.learning.experiments.tables import LOGS, Table, read_table, rows_where, write_table
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import CONFIG, RunConfig, read_config
from swimmer_mj.learning.runs.run import LOG as METRICS_LOG
from swimmer_mj.learning.runs.run import Metrics, TrainingRun
from swimmer_mj.learning.runs.together import Report, train_together
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import ETA, TemporalDifferences
from swimmer_mj.parameters import SwimmerParameters

__all__ = [
    "ANGLES",
    "ETAS",
    "SEEDS",
    "SWIMMERS",
    "Swimmer",
    "collect",
    "configurations",
    "open_run",
    "open_runs",
    "paper_runs",
    "run",
    "run_angles",
]

SEEDS = range(8)
EVALUATE_EVERY = 20_000
"""Trials between rows of the log."""
ETAS = {"paper": 0.01, "tuned": ETA}
"""The paper's learning rate, and the best of a sweep (docs/what-decides.md)."""
RAW_ETAS = {"paper": 0.01, "quarter": 0.0025}
RAW_TRIALS = {"paper": 1_000_000, "quarter": 1_000_000}
"""With angles as inputs, where larger rates diverge."""


class Swimmer(NamedTuple):
    """What is learned, and for how long."""

    links: int
    neurons: int
    """Of the cascade, the output counted."""
    trials: dict[str, int]
    """By preset."""
    steps_per_s: float
    """Learning steps that one learner alone does on one core of the machine of docs/performance.md, about."""
    encoding: Literal["circle", "angle", "unwrapped"] = "circle"
    etas: Mapping[str, float] = ETAS
    """Learning rates, by preset."""


SWIMMERS = {
    "swim3": Swimmer(3, 30, {"paper": 400_000, "tuned": 400_000}, 1.0e6),
    "swim4": Swimmer(4, 60, {"paper": 300_000, "tuned": 300_000}, 4.7e5),
    "swim5": Swimmer(5, 60, {"paper": 3_000_000, "tuned": 1_000_000}, 4.38e5),
    "swim5-angle": Swimmer(5, 60, RAW_TRIALS, 4.38e5, "angle", RAW_ETAS),
    "swim5-unwrapped": Swimmer(5, 60, RAW_TRIALS, 4.38e5, "unwrapped", RAW_ETAS),
}
ANGLES = ("swim5-angle", "swim5-unwrapped")
"""Those that hear angles, not their cosines and sines."""


def configurations(name: str, preset: str) -> dict[str, RunConfig]:
    """The runs of a swimmer with a preset: directory below the study's, and configuration."""
    swimmer = SWIMMERS[name]
    return {
        f"{name}-{preset}/seed-{seed}": RunConfig(
            Swimming(SwimmerParameters(n_links=swimmer.links), encoding=swimmer.encoding),
            TemporalDifferences(TDSettings(eta=swimmer.etas[preset]), swimmer.neurons, engine="population"),
            seed,
            EVALUATE_EVERY,
        )
        for seed in SEEDS
    }


def open_run(path: Path, config: RunConfig) -> TrainingRun:
    """The run, new or as it was left; ValueError if another one is there."""
    if not (path / CONFIG).exists():
        return TrainingRun(path, config)
    if read_config(path) != config:
        raise ValueError(f"{path} holds a run with other settings; choose another directory with --out")
    return TrainingRun(path, resume=True)


def open_runs(name: str, preset: str, directory: Path) -> list[TrainingRun]:
    """The runs of a swimmer with a preset: :func:`open_run`."""
    return [open_run(directory / path, config) for path, config in configurations(name, preset).items()]


def collect(name: str, runs: Path, log: Path) -> None:
    """Write the metrics of all runs of a swimmer, as far as they have come, to one table."""
    rows = []
    for preset in SWIMMERS[name].etas:
        for path, config in configurations(name, preset).items():
            metrics = runs / path / METRICS_LOG
            if metrics.exists():
                with metrics.open(newline="") as file:
                    for row in csv.DictReader(file):
                        rows.append(
                            (preset, config.seed, *(float(row[column]) for column in Metrics._fields))
                        )
    write_table(log, ("preset", "seed", *Metrics._fields), rows)


def run(name: str, directory: str | os.PathLike[str] = LOGS, report: Callable[[str], None] = print) -> None:
    """Go on with the runs of a swimmer in ``directory``/runs, to their end; log beside."""
    directory = Path(directory)

    def news(news: Report) -> None:
        if (row := news.metrics) is not None:
            where = news.run.directory.relative_to(directory)
            report(f"{where}: trial {row.trial:,}, <V> {row.mean_value:.3f} m, speed {row.speed:.3f} m/s")

    opened = {preset: open_runs(name, preset, directory / "runs") for preset in SWIMMERS[name].etas}
    try:
        # Both presets in one pack, and what has more trials to do alone after that
        for trials in sorted(set(SWIMMERS[name].trials.values())):
            unfinished = [
                run for preset in opened if SWIMMERS[name].trials[preset] >= trials for run in opened[preset]
            ]
            train_together(unfinished, trials=trials, report=news, workers=1)
    finally:  # a run that diverged or an interruption leaves what the others have learned
        if any(run.history for runs in opened.values() for run in runs):
            collect(name, directory / "runs", directory / f"{name}.csv")


def run_angles(directory: str | os.PathLike[str] = LOGS, report: Callable[[str], None] = print) -> None:
    """As :func:`run`, of all :data:`ANGLES`. A run that diverges is a result: its rows end where it last was sound."""
    for name in ANGLES:
        try:
            run(name, directory, report)
        except FloatingPointError as error:
            report(str(error))


def paper_runs(directory: str | os.PathLike[str], end: float) -> Table:
    """The rows of 5 links by the paper's rate, with cosines and sines as inputs, to trial ``end``.

    The committed log's, where the directory has none.
    """
    log = Path(directory) / "swim5.csv"
    rows = rows_where(read_table(log if log.exists() else LOGS / "swim5.csv"), preset="paper")
    return {name: column[rows["trial"] <= end] for name, column in rows.items()}
