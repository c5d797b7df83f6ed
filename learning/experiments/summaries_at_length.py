"""The longer studies in numbers: inputs, rates, noise and tile coding; made from the logs, as the figures are."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments import linear_swimmer, long_runs, noise_at_length, rates_at_length
from swimmer_mj.learning.experiments.section_3_3 import power_of_n
from swimmer_mj.learning.experiments.section_3_4 import METHODS
from swimmer_mj.learning.experiments.tables import LOGS, Summary, Table, read_table, rows_where

__all__ = ["INPUTS", "linear", "noise", "rates", "raw_angles"]

Logs = str | os.PathLike[str]

INPUTS = {
    "swim5": "17: cosines and sines",
    "swim5-angle": "12: angles within a turn",
    "swim5-unwrapped": "12: angles, turns counted",
}
"""What the network hears, by the log."""
FAST = 0.9
"""m/s."""


def _thousands(trials: float) -> str:
    return f"{trials / 1e6:g}M" if trials >= 1e6 else f"{trials / 1e3:g}k"


def _first_time(rows: Table) -> str:
    """Median over seeds of the trials after which :data:`FAST` was first seen, and how many got there."""
    seeds = [rows_where(rows, seed=float(seed)) for seed in np.unique(rows["seed"])]
    reached = [one["trial"][one["reward"] >= FAST] for one in seeds]
    first = np.array([at[0] if at.size else np.inf for at in reached])
    there = int(np.isfinite(first).sum())
    middle = float(np.median(first))
    return f"{_thousands(middle) if np.isfinite(middle) else 'not'}; {there} of {len(seeds)}"


def raw_angles(logs: Logs = LOGS) -> Summary:
    """Speeds with angles as inputs beside those with cosines and sines, and which seeds diverged."""
    tables = {name: read_table(Path(logs) / f"{name}.csv") for name in long_runs.ANGLES}
    end = max(float(table["trial"].max()) for table in tables.values())
    tables = {"swim5": long_runs.paper_runs(logs, end), **tables}
    marks = [mark for mark in (100_000.0, 300_000.0, 1_000_000.0) if mark <= end]
    rows = []
    for name, table in tables.items():
        for preset, eta in long_runs.SWIMMERS[name].etas.items():
            of = rows_where(table, preset=preset)
            if not of["seed"].size:
                continue
            whole = int((of["trial"] == end).sum())
            speeds = [_mean(rows_where(of, trial=mark)["speed"]) for mark in marks]
            best = max(of["speed"])
            count = len(long_runs.SEEDS)
            rows.append((INPUTS[name], f"{eta:g}", f"{count - whole} of {count}", *speeds, f"{best:.2f}"))
    header = (
        "inputs",
        "η",
        "diverged",
        *(f"{_thousands(mark)} trials, m/s" for mark in marks),
        "best look, m/s",
    )
    return Summary("5 links, 60 neurons: speeds of those that did not diverge until then", header, rows)


def rates(logs: Logs = LOGS) -> Summary:
    """The four ways to set rates: best setting, speeds along training."""
    table = read_table(Path(logs) / rates_at_length.LEARNING_LOG)
    end = float(table["trial"].max())
    marks = [mark for mark in (10_000.0, 30_000.0, 100_000.0, 200_000.0) if mark <= end]
    rows = []
    for method in METHODS:
        of = rows_where(table, method=method)
        speeds = [_mean(rows_where(of, trial=mark)["reward"]) for mark in marks]
        at_end = rows_where(of, trial=end)
        bound = f", {of['bound'][0]:g}" if of["bound"][0] else ""
        lost = f"{int(at_end['diverged'].sum())} of {len(at_end['seed'])}"
        rows.append((method, f"{of['eta'][0]:g}{bound}", lost, *speeds, _first_time(of)))
    header = ("method", "η and ε or μ", "diverged", *(f"{_thousands(mark)} trials, m/s" for mark in marks),
              f"trials to {FAST} m/s, median")  # fmt: skip
    return Summary("5 links, 60 neurons: rates of the weights by four methods", header, rows)


def noise(logs: Logs = LOGS) -> Summary:
    """Section 3.3's ratio divided by n along training, and its exponent in n."""
    table = read_table(Path(logs) / noise_at_length.LOG)
    table["ratio"] = table["output"] / table["internal"]
    sizes = np.unique(table["n"]).tolist()
    rows = []
    for eta in np.unique(table["eta"]).tolist():
        for trial in np.unique(table["trial"]).tolist():
            now = rows_where(table, eta=eta, trial=trial)
            cells = [rows_where(now, n=n)["ratio"] / n for n in sizes]
            rows.append((f"{eta:g}", _thousands(trial), *map(_mean, cells), _power(now), _power(_many(now))))
    header = ("η", "trials", *(f"n = {n:g}" for n in sizes), "exponent", "from 30 neurons on")
    return Summary("ratio of variances divided by n, and the exponent of the ratio in n", header, rows)


def _mean(values: Sequence[float] | NDArray[np.float64]) -> str:
    return mean_and_interval_text(np.asarray(values)) if len(values) else "-"


def _many(rows: Table) -> Table:
    return {name: column[rows["n"] >= 30] for name, column in rows.items()}


def _power(rows: Table) -> str:
    if len(np.unique(rows["n"])) < 2:
        return "-"
    b, half, _ = power_of_n(rows["n"], rows["ratio"])
    return f"{b:.2f} ± {half:.2f}"


def linear(logs: Logs = LOGS) -> Summary:
    """Tile coding and the cascade with 3 links."""
    table = rows_where(read_table(Path(logs) / linear_swimmer.LOG), stage="final")
    end = float(table["trial"].max())
    marks = [mark for mark in (6_000.0, 18_000.0, 60_000.0) if mark <= end]
    rows = []
    for name in ("cascade", "tile coding"):
        of = rows_where(table, approximator=name)
        speeds = [_mean(rows_where(of, trial=mark)["speed"]) for mark in marks]
        last = rows_where(of, trial=end)
        used = f"{100 * np.mean(last['used']):.0f} %"
        rows.append((name, f"{of['weights'][0]:,.0f}", used, f"{np.median(last['seconds']):.0f}", *speeds))
    header = (
        "V by",
        "weights",
        "not 0",
        "seconds of a core",
        *(f"{_thousands(mark)} trials, m/s" for mark in marks),
    )
    return Summary("3 links: tile coding beside the cascade", header, rows)
