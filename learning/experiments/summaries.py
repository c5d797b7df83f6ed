"""The experiments' results in numbers: tables made from the logs, as the figures are.

:data:`TABLES` has them by the name of the experiment; ``swimmer-mj figures NAME`` prints them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments import (
    long_runs,
    section_3_3,
    summaries_at_length,
    value_gradients,
    what_decides,
)
from swimmer_mj.learning.experiments.tables import LOGS, Summary, Table, read_table, rows_where, settings_of
from swimmer_mj.learning.td.continuous_td import TDSettings

__all__ = [
    "FAST",
    "TABLES",
    "Peak",
    "Summary",
    "ablation",
    "gain_at_equal_time",
    "lasting",
    "learners",
    "learning_times",
    "noise_ratios",
    "peaks",
    "speeds_by_links",
    "speeds_by_setting",
    "trials_to",
]

Array = NDArray[np.float64]
Logs = str | os.PathLike[str]

SHARES = (0.5, 0.8, 0.95)
"""Of a run's top speed."""


# Long runs ---------------------------------------------------------------------------------------------------------


class Peak(NamedTuple):
    """The best of one run, and what became of it."""

    seed: int
    peak: float
    """Highest speed at an evaluation, m/s."""
    at: float
    """Trials, or steps of simulation, then."""
    lowest_after: float
    """Lowest speed at a later evaluation, m/s; the peak itself if it is the last."""
    fell_from: float
    """The best until then, when the run was furthest below its best so far, m/s."""
    fell_to: float
    """Speed then."""
    last: float
    """Speed at the last evaluation, m/s."""
    end: float
    """Trials, or steps of simulation, at the last evaluation."""


def _runs(table: Table, preset: str) -> list[Table]:
    """The rows of each seed of a preset."""
    rows = rows_where(table, preset=preset)
    return [rows_where(rows, seed=float(seed)) for seed in np.unique(rows["seed"])]


def _peak(run: Table, clock: str) -> Peak:
    """Of the rows of one run, whose column ``clock`` says when."""
    at, speed = run[clock], run["speed"]
    best = int(np.argmax(speed))
    best_so_far = np.maximum.accumulate(speed)
    fall = int(np.argmax(best_so_far - speed))
    fell = best_so_far[fall], speed[fall]
    numbers = speed[best], at[best], speed[best:].min(), *fell, speed[-1], at[-1]
    return Peak(int(run["seed"][0]), *map(float, numbers))


def peaks(table: Table, preset: str) -> list[Peak]:
    """For each seed of a preset."""
    return [_peak(run, "trial") for run in _runs(table, preset)]


def trials_to(table: Table, preset: str, share: float) -> Array:
    """Trials of each seed when an evaluation first saw ``share`` of that seed's top speed, shape (seeds,)."""
    return np.array(
        [run["trial"][np.argmax(run["speed"] >= share * run["speed"].max())] for run in _runs(table, preset)]
    )


def _count(trials: float) -> str:
    """In thousands or millions."""
    return f"{trials / 1e6:.2f}M" if trials >= 1e6 else f"{trials / 1e3:.0f}k"


def _counts(trials: Array) -> str:
    """Median and quartiles over seeds."""
    low, middle, high = map(_count, np.quantile(trials, [0.25, 0.5, 0.75]))
    return f"{middle} [{low}, {high}]"


def learning_times(name: str, logs: Logs = LOGS) -> Summary:
    """Trials and hours to shares of the top speed, for each preset of a swimmer, the paper's beside them."""
    table = read_table(Path(logs) / f"{name}.csv")
    swimmer = long_runs.SWIMMERS[name]

    def hours(trials: float) -> str:
        return f"{trials * TDSettings().steps_per_trial / swimmer.steps_per_s / 3600:.2f}"

    rows = []
    for preset, eta in long_runs.ETAS.items():
        if preset not in table["preset"]:
            continue
        runs = peaks(table, preset)
        label = f"{eta:g}, {len(runs)} {'seed' if len(runs) == 1 else 'seeds'}"
        top = np.array([run.peak for run in runs])
        for share in (*SHARES, 1.0):
            trials = trials_to(table, preset, share)
            speed = mean_and_interval_text(share * top)
            rows.append((label, f"{share:.0%}", speed, _counts(trials), hours(float(np.median(trials)))))
        last = np.array([run.last for run in runs])
        end = min(run.end for run in runs)
        kept = f"last: {float(np.median(last / top)):.0%}"
        rows.append((label, kept, mean_and_interval_text(last), _count(end), hours(end)))
    if name == "swim5":
        rows.append(("paper, 1 run", "100%", "-", "2.50M", "168"))
        rows.append(("paper, 1 run", "collapsed", "-", "-", "-"))
    return Summary(
        f"{swimmer.links} links, {swimmer.neurons} neurons: when a run first had a share of its own top speed; "
        "speeds are means over seeds [95 % interval], trials, and the last share, are medians [quartiles]; "
        f"hours are of one learner alone on one core, {swimmer.steps_per_s:,.0f} steps/s (the paper's at 800 MHz)",
        ("eta", "share", "m/s", "trials", "hours"),
        rows,
    )


# Others ------------------------------------------------------------------------------------------------------------


def noise_ratios(logs: Logs = LOGS) -> Summary:
    """Section 3.3: the ratio of output and internal variances, divided by the number of neurons."""
    table = rows_where(read_table(Path(logs) / section_3_3.LOG), output_scaling=1)
    rows = []
    for problem in dict.fromkeys(table["problem"].tolist()):
        of_problem = rows_where(table, problem=problem)
        for trial in np.unique(of_problem["trial"]):
            for n in np.unique(of_problem["n"]):
                cell = rows_where(of_problem, trial=float(trial), n=float(n))
                ratio = cell["output"] / cell["internal"] / n
                seeds = len(np.unique(cell["seed"]))
                rows.append((problem, f"{trial:,.0f}", f"{n:.0f}", str(seeds), mean_and_interval_text(ratio)))
    return Summary(
        "variance on connections to the output over that of internal ones, divided by n",
        ("problem", "trials", "n", "seeds", "ratio / n"),
        rows,
    )


def speeds_by_setting(logs: Logs = LOGS) -> Summary:
    """The sweep: speed and mean squared Hamiltonian at the end with one choice changed."""
    table = read_table(Path(logs) / what_decides.LOG)
    end = table["simulated_seconds"].max()
    rows = []
    for factor, setting in settings_of(table):
        at_end = rows_where(table, factor=factor, setting=setting, simulated_seconds=float(end))
        speed, squared = at_end["speed"], at_end["mean_squared_hamiltonian"]
        lost = int(np.isnan(squared).sum())
        rows.append(
            (
                factor,
                setting,
                f"{len(speed)}, {lost} of them diverged" if lost else str(len(speed)),
                mean_and_interval_text(speed),
                f"{np.median(speed):z.2f}",
                f"{np.nanmedian(squared):.2g}",
            )
        )
    return Summary(
        f"one choice changed at a time, after {end:,.0f} s of simulated time",
        ("factor", "setting", "seeds", "speed, m/s", "median", "median <H²>, m²/s²"),
        rows,
    )


# Value gradients ---------------------------------------------------------------------------------------------------

FAST = 1.5
"""m/s; how long it takes to get there tells quick learners from slow ones."""


def learners(table: Table) -> list[Table]:
    """The rows of each seed. A learner that has diverged, whose speeds are nan, counts as one that lies still."""
    speed, diverged = table["speed"], np.isnan(table["speed"])
    still = {**table, "speed": np.where(diverged, 0.0, speed), "diverged": diverged}
    return [rows_where(still, seed=float(seed)) for seed in np.unique(table["seed"])]


def _end(one: Table) -> float:
    """Processor time for which the rows tell of one learner; for ever, if it has diverged."""
    return math.inf if one["diverged"][-1] else float(one["cpu_seconds"][-1])


def gain_at_equal_time(ones: list[Table], others: list[Table]) -> Array:
    """By how much ``ones`` are faster than ``others`` of the same seed when they had as much processor time, m/s.

    Which is when the first of both ends; speeds are interpolated between looks. Shape (seeds of both,).
    """
    of_seed = {float(other["seed"][0]): other for other in others}
    gains = []
    for one in ones:
        if (other := of_seed.get(float(one["seed"][0]))) is not None:
            time = min(_end(one), _end(other))
            speed, its = (np.interp(time, run["cpu_seconds"], run["speed"]) for run in (one, other))
            gains.append(speed - its)
    return np.array(gains)


def ablation(logs: Logs = LOGS) -> Summary:
    """Value gradients with one setting changed: speed at the end and at equal time, and time until they are fast."""
    table = read_table(Path(logs) / value_gradients.ABLATION_LOG)
    rows = []
    chosen: list[Table] = []
    for factor, setting in settings_of(table):
        of_setting = rows_where(table, factor=factor, setting=setting)
        seeds = learners(of_setting)
        chosen = chosen or seeds
        lost = sum(bool(one["diverged"][-1]) for one in seeds)
        fast = [one["cpu_seconds"][one["speed"] >= FAST] for one in seeds]
        times = np.array([at[0] if len(at) else np.inf for at in fast])
        there = int(np.isfinite(times).sum())
        at_least = float(np.median([min(time, _end(one)) for time, one in zip(times, seeds, strict=True)]))
        more = "" if np.isfinite(np.median(times)) else "> "
        rows.append(
            (
                factor,
                setting or "-",
                f"{of_setting['weights'][0]:,.0f}",
                f"{len(seeds)}, {lost} of them diverged" if lost else str(len(seeds)),
                mean_and_interval_text(np.array([one["speed"][-1] for one in seeds])),
                "-" if seeds is chosen else mean_and_interval_text(gain_at_equal_time(seeds, chosen)),
                f"{more}{at_least:.1f}" if np.isfinite(at_least) else "never",
                str(there),
            )
        )
    steps = float(table["simulation_steps"].max()) / 1e6
    return Summary(
        f"value gradients with one setting changed at a time, {steps:.0f} million steps of simulation; a learner that "
        "diverged counts as 0 m/s; gain: on the settings as chosen, with as much processor time and the same seed; "
        "seconds are of one core, median over seeds, of which those that did not get there took longer than they had",
        (
            "factor",
            "setting",
            "weights",
            "seeds",
            "speed at the end, m/s",
            "gain, m/s",
            f"s to {FAST} m/s",
            "seeds there",
        ),
        rows,
    )


def speeds_by_links(logs: Logs = LOGS) -> Summary:
    """Value gradients with more and fewer links."""
    table = read_table(Path(logs) / value_gradients.LINKS_LOG)
    rows = []
    for n in np.unique(table["setting"]):
        seeds = learners(rows_where(table, setting=float(n)))
        best = np.array([one["speed"].max() for one in seeds])
        last = np.array([one["speed"][-1] for one in seeds])
        seconds = float(np.median([one["cpu_seconds"][-1] for one in seeds]))
        speeds = mean_and_interval_text(last), mean_and_interval_text(best), f"{best.max():.2f}"
        rows.append((f"{n:.0f}", str(len(seeds)), *speeds, f"{seconds:.0f}"))
    steps = float(table["simulation_steps"].max()) / 1e6
    return Summary(
        f"value gradients, {steps:.0f} million steps of simulation; seconds are of one core",
        ("links", "seeds", "speed at the end, m/s", "best of each, m/s", "best of all, m/s", "seconds"),
        rows,
    )


def _learned(one: Table) -> int:
    """The look at which a learner first has 95 % of its top speed."""
    return int(np.argmax(one["speed"] >= 0.95 * one["speed"].max()))


def _lowest_since(one: Table) -> float:
    """From that look on, the lowest speed as a share of the best until then."""
    best = np.maximum.accumulate(one["speed"])
    return float(np.min((one["speed"] / np.where(best > 0, best, 1.0))[_learned(one) :]))


def lasting(logs: Logs = LOGS) -> Summary:
    """Value gradients, ten times as long as they need: when each seed had learned, and how far it fell since."""
    table = read_table(Path(logs) / value_gradients.LASTING_LOG)
    as_chosen, at_least_1e_4 = (
        learners(rows_where(table, factor=one.factor, setting=one.setting)) for one in value_gradients.LASTING
    )
    other_rate = {float(one["seed"][0]): f"{_lowest_since(one):.1%}" for one in at_least_1e_4}
    rows = []
    for one in as_chosen:
        run, learned = _peak(one, "simulation_steps"), _learned(one)
        rows.append(
            (
                str(run.seed),
                f"{one['simulation_steps'][learned] / 1e6:.0f}",
                f"{run.peak:.3f}",
                f"{run.at / 1e6:.0f}",
                f"{_lowest_since(one):.1%}",
                f"{run.last:.3f}",
                f"{one['speed_last'][learned:].min():.2f}",
                other_rate.get(run.seed, "-"),
            )
        )
    steps = float(table["simulation_steps"].max()) / 1e6
    return Summary(
        f"value gradients for {steps:.0f} million steps of simulation, a look each million; at 95 %: millions until "
        "95 % of the peak; lowest since: share of the best until then; not averaged: the lowest speed since of the "
        "last weights; rate 1e-4: lowest since, of learners whose learning rate stops falling there",
        (
            "seed",
            "at 95 %",
            "peak, m/s",
            "at",
            "lowest since",
            "at the end, m/s",
            "not averaged, m/s",
            "rate 1e-4",
        ),
        rows,
    )


TABLES: dict[str, Callable[[Logs], Summary]] = {
    "figure-2": partial(learning_times, "swim5"),
    "figure-2-3-links": partial(learning_times, "swim3"),
    "figure-2-4-links": partial(learning_times, "swim4"),
    "raw-angles": summaries_at_length.raw_angles,
    "section-3.3": noise_ratios,
    "noise-at-length": summaries_at_length.noise,
    "rates-at-length": summaries_at_length.rates,
    "linear-swimmer": summaries_at_length.linear,
    "what-decides": speeds_by_setting,
    "value-gradient-ablation": ablation,
    "value-gradient-links": speeds_by_links,
    "value-gradient-lasting": lasting,
}
"""What sums up the logs of each experiment that has a table."""
