"""The long runs behind figure 2: 3, 4 and 5 links, the paper's learning rate and a larger one, eight seeds each.

    python -m swimmer_mj.learning.experiments.long_runs --out runs [--names swim5] [--seconds 3600]

starts what is not there and goes on with what is, until each run has its trials. The sixteen runs of a swimmer are one
pack of :mod:`swimmer_mj.learning.population`; what a run computes depends neither on interruptions nor on the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import tyro
from rich.console import Console

from swimmer_mj.learning.continuous_td import TDSettings
from swimmer_mj.learning.trainer import Report, TrainConfig, TrainingRun, train_together
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["ETAS", "SEEDS", "SWIMMERS", "Swimmer", "configurations", "open_runs"]

SEEDS = range(8)
ETAS = {"paper": 0.01, "tuned": 0.04}
"""The paper's learning rate, and the largest with which no seed of a first look diverged."""


class Swimmer(NamedTuple):
    """What is learned, and for how long."""

    links: int
    neurons: int
    """Of the cascade, the output counted."""
    trials: int


SWIMMERS = {
    "swim3": Swimmer(3, 30, 1_000_000),
    "swim4": Swimmer(4, 60, 1_000_000),
    "swim5": Swimmer(5, 60, 3_000_000),
}


def configurations(name: str) -> dict[str, TrainConfig]:
    """The runs of a swimmer: directory below the study's, and configuration."""
    swimmer = SWIMMERS[name]
    return {
        f"{name}-{preset}/seed-{seed}": TrainConfig(
            seed=seed,
            parameters=SwimmerParameters(n_links=swimmer.links),
            td=TDSettings(eta=eta),
            neurons=swimmer.neurons,
            engine="population",
            evaluate_every=20_000,
        )
        for preset, eta in ETAS.items()
        for seed in SEEDS
    }


def open_runs(name: str, directory: Path) -> list[TrainingRun]:
    """The runs of a swimmer, new or as they were left."""
    return [
        TrainingRun(directory / path, resume=True)
        if (directory / path / "config.json").exists()
        else TrainingRun(directory / path, config)
        for path, config in configurations(name).items()
    ]


def main(out: Path, names: Sequence[str] = tuple(SWIMMERS), seconds: float | None = None) -> None:
    """Go on with the long runs.

    Args:
        out: Directory of all runs.
        names: Which swimmers, one after the other.
        seconds: Stop after this time; what was learned since the last evaluation is then learned again.
    """
    console = Console()

    def report(news: Report) -> None:
        if news.metrics is not None:
            row = news.metrics
            console.print(
                f"{news.run.directory} trial {row.trial:,} <V> {row.mean_value:.3f} speed {row.speed:.3f}"
            )

    for name in names:
        train_together(
            open_runs(name, out), trials=SWIMMERS[name].trials, seconds=seconds, report=report, workers=1
        )


if __name__ == "__main__":
    tyro.cli(main)
