"""The learners of this project beside each other: time and simulation to reach a speed, in a table and a plot.

    python benchmarks/compare_learners.py

reads what ``own_learners.py`` wrote, and draws docs/images/learners.png. A learner reaches a speed at its first look at
that speed or more. A seed that was stopped before it got there took longer than it was given: ratios are of medians
over all seeds, and a median that falls among such seeds is known to be more than so much. Others' learners are in
``tournament.py``.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.render.bands import end_key, mark_ends
from swimmer_mj.render.figures import COLORS, HANDLE, line, plain_axes, save_figure

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "own-learners.csv"
PLOT = ROOT / "docs" / "images" / "learners.png"
NAMES = {
    "value-gradient": "value gradients",
    "value-gradient-joints": "value gradients, joints",
    "td": r"TD($\lambda$), $\eta$ = 0.16",
    "ppo": "PPO",
    "sac": "SAC",
    "td3": "TD3",
    "ours": "value gradients, compiled",
    "ours-torch": "value gradients, torch",
    "ours-thrifty": "value gradients, thrifty",
    "shac": "SHAC",
    "apg": "APG",
    "cfvi": "cFVI",
}
SPEEDS = (1.0, 1.5, 2.0)  # m/s

Array = NDArray[np.float64]


class Curve(NamedTuple):
    """Looks at one learner."""

    cpu_seconds: Array
    simulation_steps: Array
    speed: Array


def read(path: Path) -> dict[str, list[Curve]]:
    """The curves of each algorithm, seed by seed."""
    rows: dict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            look = float(row["cpu_seconds"]), float(row["simulation_steps"]), float(row["speed"])
            rows[row["algorithm"], int(row["seed"])].append(look)
    curves: dict[str, list[Curve]] = {name: [] for name in NAMES if any(name == key for key, _ in rows)}
    for (name, _), looks in sorted(rows.items()):
        curves[name].append(Curve(*np.array(looks).T))
    return curves


class Reached(NamedTuple):
    """What the seeds of a learner had spent of a quantity when they reached a speed."""

    spent: Array
    """By each seed, shape (seeds,); infinite where it did not get there."""
    given: Array
    """What each seed was given, shape (seeds,)."""
    at_first_look: int
    """How many were there when they were first looked at, and may have been there before."""

    @property
    def got_there(self) -> str:
        """How many seeds got there."""
        text = f"{np.isfinite(self.spent).sum()} of {len(self.spent)}"
        return f"{text}, {self.at_first_look} by the first look" if self.at_first_look else text

    @property
    def median(self) -> float:
        """Over all seeds, or the least that it can be."""
        return float(np.median(np.minimum(self.spent, self.given)))

    @property
    def known(self) -> bool:
        """Whether the median is that number, not more."""
        return float(np.median(self.spent)) == self.median


def reached(curves: Sequence[Curve], speed: float, quantity: str) -> Reached:
    """What each curve had spent of a quantity at its first look at a speed."""
    spent, given, at_first_look = [], [], 0
    for curve in curves:
        fast, amount = curve.speed >= speed, getattr(curve, quantity)
        spent.append(amount[np.argmax(fast)] if fast.any() else np.inf)
        given.append(amount[-1])
        at_first_look += bool(fast[0])
    return Reached(np.array(spent), np.array(given), at_first_look)


def number(value: float) -> str:
    """Three digits, or all of those before the point."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def mean_words(values: Array, unit: str) -> str:
    """Mean and 95 % interval; of a few, which have none to speak of, each."""
    if len(values) < 5:
        return f"{', '.join(map(number, values))} {unit}"
    mean, (low, high) = mean_and_interval(values)
    return f"{number(mean)} {unit} [{number(low)}, {number(high)}]"


def median_words(what: Reached, unit: str, scale: float = 1.0) -> str:
    """Median over all seeds, as far as it is known."""
    return f"median {'' if what.known else '> '}{number(scale * what.median)} {unit}"


def words(what: Reached, unit: str, scale: float) -> str:
    """Median over all seeds, their mean where all got there, and how many got there."""
    texts = [median_words(what, unit, scale), what.got_there]
    if np.isfinite(what.spent).all():
        texts.insert(
            1, f"{'mean' if len(what.spent) >= 5 else 'each'} {mean_words(scale * what.spent, unit)}"
        )
    return "; ".join(texts)


def ratio_words(ours: Reached, name: str, other: Reached, unit: str) -> str:
    """The medians of value gradients and of another learner, and their ratio as far as it is known."""
    mine, its = median_words(ours, unit), median_words(other, unit)
    text = f"{mine} ({ours.got_there}), {name} {its} ({other.got_there})"
    if not ours.known:
        return text
    times = other.median / ours.median
    return f"{text}: 1/{times:.0f}" if other.known else f"{text}: less than 1/{math.floor(times)}"


def top_speed_words(curves: Sequence[Curve]) -> str:
    """The highest speed of any seed, and when it was seen first."""
    fastest = max(curves, key=lambda curve: curve.speed.max())
    at = fastest.cpu_seconds[np.argmax(fastest.speed)]
    return f"{fastest.speed.max():.2f} m/s after {number(at)} s"


def print_tables(curves: dict[str, list[Curve]], console: Console) -> None:
    """Time, simulation, the best speed; then the share of TD(lambda)'s simulation, by medians."""
    for quantity, unit, scale in (("cpu_seconds", "s", 1.0), ("simulation_steps", "million steps", 1e-6)):
        table = Table(
            "learner", *(f"{speed} m/s" for speed in SPEEDS), "best, m/s", title=f"to reach, {unit}"
        )
        for name, of_name in curves.items():
            cells = [words(reached(of_name, speed, quantity), unit, scale) for speed in SPEEDS]
            best = mean_words(np.array([curve.speed.max() for curve in of_name]), "m/s")
            table.add_row(name, *cells, best)
        console.print(table)
    tops = (f"{name} {top_speed_words(of_name)}" for name, of_name in curves.items())
    console.print(f"top speed of any seed: {', '.join(tops)}")
    if "value-gradient" in curves and "td" in curves:
        ours, paper = (reached(curves[name], 1.0, "simulation_steps") for name in ("value-gradient", "td"))
        console.print(f"1.0 m/s: {ratio_words(ours, 'TD(lambda)', paper, 'simulation steps')}")


def draw_curves(axes: Axes, curves: Mapping[str, list[Curve]], quantity: str) -> None:
    """Speed against a quantity: median over seeds, as far as all go, each seed faint behind."""
    plain_axes(axes)
    medians = []
    for color, (name, of_name) in zip(COLORS, curves.items(), strict=False):
        for curve in of_name:
            axes.plot(getattr(curve, quantity), curve.speed, color=color, linewidth=0.6, alpha=0.35)
        start = max(getattr(curve, quantity)[0] for curve in of_name)
        end = min(getattr(curve, quantity)[-1] for curve in of_name)
        at = np.geomspace(start, end, 200)
        speeds = [np.interp(at, getattr(curve, quantity), curve.speed) for curve in of_name]
        label = f"{NAMES[name]}, {len(of_name)} seed{'s' * (len(of_name) > 1)}"
        medians += axes.plot(at, np.median(speeds, axis=0), linewidth=1.8, label=label, **line(color))
    mark_ends(axes, medians)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)


def draw(curves: Mapping[str, list[Curve]]) -> Figure:
    """Speed against processor time and against simulation."""
    figure = Figure(figsize=(9.6, 4.4), layout="constrained")
    time, simulation = figure.subplots(1, 2, sharey=True)
    draw_curves(time, curves, "cpu_seconds")
    draw_curves(simulation, curves, "simulation_steps")
    time.set_xlabel("processor time of one core  (s)")
    time.xaxis.set_major_formatter(EngFormatter(sep=""))
    simulation.set_xlabel("simulation steps of 0.01 s")
    simulation.xaxis.set_major_formatter(EngFormatter(sep=""))
    time.set_ylabel("swimming speed  (m/s)")
    handles, _ = time.get_legend_handles_labels()
    handles.append(end_key("ends where a seed was stopped"))
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False, handlelength=HANDLE)
    return figure


def main(results: Path = RESULTS, picture: Path | None = PLOT) -> None:
    """Print the tables and draw the plot.

    Args:
        results: CSV file of looks at learners.
        picture: Where to draw them; None for nowhere.
    """
    if not results.exists():
        raise SystemExit(f"there is no {results}; run own_learners.py first")
    curves = read(results)
    print_tables(curves, Console(width=150))
    if picture is not None:
        save_figure(draw(curves), picture)


if __name__ == "__main__":
    tyro.cli(main)
