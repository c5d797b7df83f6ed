"""The learners of this project beside Stable-Baselines3's: time and simulation to reach a speed, in a table and a plot.

    python benchmarks/compare_learners.py

reads what ``own_learners.py`` and ``peers_sb3.py`` wrote, and draws docs/images/learners.png. A learner reaches a speed
at its first look at that speed or more.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Sequence
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

from swimmer_mj.learning.evaluation import mean_and_interval
from swimmer_mj.render.figures import COLORS, plain_axes, save_figure

RESULTS = (Path("benchmarks/results/own-learners.csv"), Path("benchmarks/results/peers-sb3.csv"))
NAMES = {
    "value-gradient": "value gradients",
    "td": r"TD($\lambda$), the paper's",
    "ppo": "PPO",
    "sac": "SAC",
    "td3": "TD3",
}
SPEEDS = (1.0, 1.5, 2.0)  # m/s

Array = NDArray[np.float64]


class Curve(NamedTuple):
    """Looks at one learner."""

    cpu_seconds: Array
    simulation_steps: Array
    speed: Array


def read(paths: Sequence[Path]) -> dict[str, list[Curve]]:
    """The curves of each algorithm, seed by seed."""
    rows: dict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    for path in paths:
        if path.exists():
            with path.open(newline="") as file:
                for row in csv.DictReader(file):
                    look = float(row["cpu_seconds"]), float(row["simulation_steps"]), float(row["speed"])
                    rows[row["algorithm"], int(row["seed"])].append(look)
    curves: dict[str, list[Curve]] = {name: [] for name in NAMES if any(name == key for key, _ in rows)}
    for (name, _), looks in sorted(rows.items()):
        curves[name].append(Curve(*np.array(looks).T))
    return curves


def reached(curves: Sequence[Curve], speed: float, quantity: str) -> Array:
    """What each curve had spent of a quantity when it reached a speed; those that did not are left out."""
    spent = []
    for curve in curves:
        (fast,) = np.nonzero(curve.speed >= speed)
        if len(fast):
            spent.append(getattr(curve, quantity)[fast[0]])
    return np.array(spent)


def words(values: Array, of: int, unit: str) -> str:
    """Mean and bootstrap 95 % interval, and how many of the seeds got there."""
    if len(values) == 0:
        return f"0 of {of}"
    mean, (low, high) = mean_and_interval(values)
    interval = f" [{low:.3g}, {high:.3g}]" if len(values) > 1 else ""
    return f"{mean:.3g} {unit}{interval}, {len(values)} of {of}"


def print_tables(curves: dict[str, list[Curve]], console: Console) -> None:
    """Time, simulation, the best speed; then how many times sooner than the fastest of the peers."""
    for quantity, unit, scale in (("cpu_seconds", "s", 1.0), ("simulation_steps", "million steps", 1e-6)):
        table = Table(
            "learner", *(f"{speed} m/s" for speed in SPEEDS), "best, m/s", title=f"to reach, {unit}"
        )
        for name, of_name in curves.items():
            cells = [words(scale * reached(of_name, speed, quantity), len(of_name), unit) for speed in SPEEDS]
            best = words(np.array([curve.speed.max() for curve in of_name]), len(of_name), "m/s")
            table.add_row(name, *cells, best)
        console.print(table)
    for speed in SPEEDS:
        times = {name: reached(of_name, speed, "cpu_seconds") for name, of_name in curves.items()}
        ours = times.get("value-gradient", np.array([]))
        peers = {name: times[name].mean() for name in ("ppo", "sac", "td3") if len(times.get(name, ()))}
        if len(ours) and peers:
            fastest = min(peers, key=peers.__getitem__)
            console.print(f"{speed} m/s: 1/{peers[fastest] / ours.mean():.0f} of the time of {fastest}")
    paper, ours = (
        reached(curves.get(name, []), 1.0, "simulation_steps") for name in ("td", "value-gradient")
    )
    if len(paper) and len(ours):
        console.print(f"1.0 m/s: 1/{paper.mean() / ours.mean():.0f} of the simulation steps of TD(lambda)")


def draw_curves(axes: Axes, curves: dict[str, list[Curve]], quantity: str) -> None:
    """Speed against a quantity: median over seeds, each seed faint behind."""
    plain_axes(axes)
    for color, (name, of_name) in zip(COLORS, curves.items(), strict=False):
        for curve in of_name:
            axes.plot(getattr(curve, quantity), curve.speed, color=color, linewidth=0.6, alpha=0.35)
        start = max(getattr(curve, quantity)[0] for curve in of_name)
        end = min(getattr(curve, quantity)[-1] for curve in of_name)
        at = np.geomspace(start, end, 200)
        speeds = [np.interp(at, getattr(curve, quantity), curve.speed) for curve in of_name]
        label = f"{NAMES[name]}, {len(of_name)} seed{'s' * (len(of_name) > 1)}"
        axes.plot(at, np.median(speeds, axis=0), color=color, linewidth=1.8, label=label)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)


def draw(curves: dict[str, list[Curve]]) -> Figure:
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
    handles, labels = time.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    return figure


def main(results: Sequence[Path] = RESULTS, picture: Path | None = Path("docs/images/learners.png")) -> None:
    """Print the tables and draw the plot.

    Args:
        results: CSV files of looks at learners.
        picture: Where to draw them; None for nowhere.
    """
    curves = read(results)
    if not curves:
        raise SystemExit(f"there are no results in {', '.join(map(str, results))}; run own_learners.py first")
    print_tables(curves, Console(width=150))
    if picture is not None:
        save_figure(draw(curves), picture)


if __name__ == "__main__":
    tyro.cli(main)
