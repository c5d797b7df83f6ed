"""Section 3.3's ratio along a million trials of the swimmer, and its exponent in the number of neurons.

:mod:`~swimmer_mj.learning.experiments.section_3_3` ends after 20,000 trials, with the ratio still falling. Here
cascades of 15 to 60 neurons learn for a million, by the paper's rate and by the one of section 3.3, eight seeds each.
At some moments v_i (beta = 1/100) is measured along 1,000 trials of a copy of each network, by the end of which its
beginning no longer counts; the run itself goes on untouched.

:func:`run` goes on with what is there. The sixteen runs of a size are one pack.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence

import numpy as np

from swimmer_mj.learning.experiments.long_runs import open_run
from swimmer_mj.learning.experiments.section_3_3 import HEADER as SHORT_HEADER
from swimmer_mj.learning.experiments.section_3_3 import noise_summary
from swimmer_mj.learning.experiments.tables import LOGS, Path, read_table, rows_of, write_table
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.runs.together import train_together
from swimmer_mj.learning.td import vario_eta
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.method import TDLearning, TemporalDifferences
from swimmer_mj.learning.td.population import PopulationTD

__all__ = ["HEADER", "LOG", "measure", "run"]

LOG = "noise-at-length.csv"
ETAS = (0.01, 0.04)
NEURONS = (15, 30, 60)
MOMENTS = (20_000, 40_000, 100_000, 200_000, 400_000, 1_000_000)
METERED = 1000
"""Trials along which v is followed: ten times as many as it remembers."""
BETA = 0.01
HEADER = ("problem", "n", "eta", *SHORT_HEADER[3:-1], "speed")
"""As of section 3.3, eta in place of the scaling, which all have, and the swimming speed in place of V."""
Row = tuple[str | float, ...]


def _open(directory: Path, n: int, eta: float, seed: int, every: int) -> TrainingRun:
    """The run below ``directory``, new or as it was left."""
    path = directory / "runs" / f"{n}-neurons" / f"eta-{eta:g}" / f"seed-{seed}"
    method = TemporalDifferences(TDSettings(eta=eta), n, engine="population")
    return open_run(path, RunConfig(Swimming(), method, seed, every))


def measure(runs: Sequence[TrainingRun], trials: int = METERED, beta: float = BETA) -> list[Row]:
    """A row of :data:`HEADER` for each run, which is left as it is."""
    learners = []
    for run in runs:
        assert isinstance(run.learning, TDLearning)
        learners.append(
            FusedTD(run.problem, copy.deepcopy(run.learning.network), run.learning.method.settings)
        )
    population = PopulationTD(learners)
    rngs = [np.random.default_rng([run.config.seed, run.trial]) for run in runs]
    connected = learners[0].network.connected.numpy()
    rate = np.stack([np.where(connected, one.rate.double().numpy(), 1.0) for one in learners])

    def weights() -> np.ndarray:
        return np.stack([one.weight.double().numpy() for one in learners])

    before = weights()
    variance, mean = np.zeros_like(before), np.zeros_like(before)
    for _ in range(trials):
        population.train(
            np.stack([run.problem.initial_states(rng, 1) for run, rng in zip(runs, rngs, strict=True)], 1)
        )
        after = weights()
        variance = vario_eta.variance(variance, after - before, rate, beta)
        mean = (1 - beta) * mean + beta * (after - before) / rate
        before = after
    rows: list[Row] = []
    for k, (run, one) in enumerate(zip(runs, learners, strict=True)):
        summary = noise_summary(variance[k], mean[k], run.problem.n_inputs)
        place = (run.problem.name, one.network.n_neurons, one.settings.eta, run.config.seed, run.trial)
        rows.append((*place, *map(float, summary), run.history[-1].speed))
    return rows


def run(
    directory: str | os.PathLike[str] = LOGS,
    *,
    neurons: Sequence[int] = NEURONS,
    etas: Sequence[float] = ETAS,
    seeds: Sequence[int] = range(8),
    moments: Sequence[int] = MOMENTS,
    metered: int = METERED,
    report: Callable[[str], None] = lambda line: None,
) -> None:
    """Learn and measure, and write :data:`LOG` in ``directory`` after each moment. About three hours on one core."""
    directory = Path(directory)
    log = directory / LOG
    rows = rows_of(read_table(log)) if log.exists() else []
    done = {(row[1], row[4]) for row in rows}
    for n in neurons:
        wanted = [(n, eta, seed, moments[0]) for eta in etas for seed in seeds]
        opened: list[TrainingRun] = []
        for moment in moments:
            if (n, moment) in done:
                continue
            opened = opened or [_open(directory, *one) for one in wanted]
            train_together(opened, trials=moment, workers=1)
            rows += measure(opened, metered)
            rows.sort(key=lambda row: [float(row[i]) for i in (1, 2, 3, 4)])
            write_table(log, HEADER, rows, digits=4)
            report(
                f"{n} neurons, {moment:,} trials: speeds {', '.join(f'{row.history[-1].speed:.2f}' for row in opened)}"
            )
