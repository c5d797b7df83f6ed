"""What came of the tournament: its tables, and its picture.

    python benchmarks/tournament_results.py

draws docs/images/tournament.png from what ``tournament.py`` wrote. A learner reaches a speed at its first look at that
speed or more; one that does not get there in its time counts as not there. What it comes to is the mean of its last
window, the second half of its time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from compare_learners import NAMES, Reached, median_words, number, reached
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, MultipleLocator
from numpy.typing import NDArray
from tournament import LIKE_OURS, OUT, PEERS, WINDOW, Name, read, tuned

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.summaries import Summary
from swimmer_mj.render.figures import BLUE, COLORS, plain_axes, save_figure

PLOT = Path(__file__).parents[1] / "docs" / "images" / "tournament.png"
SPEEDS = (1.0, 1.5, 2.0, 2.4)  # m/s
AXES = {
    "cpu_seconds": "processor time of one core  (s)",
    "simulation_steps": "simulation steps of 0.01 s",
    "gradient_evaluations": "gradients of steps",
}
GOALS = {
    "cpu_seconds": ("s", 1 / 3),
    "simulation_steps": ("steps", 1 / 2),
    "gradient_evaluations": ("gradients", None),
}
"""Units, and what share of the soonest peer's was the goal."""
STYLES = ("-", "--", "-.", ":")
OURS = ("ours", *LIKE_OURS)
Array = NDArray[np.float64]


class Looks(NamedTuple):
    """At one learner."""

    cpu_seconds: Array
    simulation_steps: Array
    gradient_evaluations: Array
    speed: Array
    steady_speed: Array
    """NaN before the last window."""
    given: float
    """s."""

    def last(self, of: Array) -> float:
        """Mean over the last window."""
        return float(of[self.cpu_seconds >= WINDOW * self.given].mean())


def at_the_pace_of(start: Sequence[Array], final: Sequence[Array]) -> list[Array]:
    """Looks at the start, their processor time as if learned as fast as in the final, where the core was another.

    The same seed learns the same in both, so that steps tell which moments are the same. As far as the final's first
    look time goes in proportion to steps, after it between the looks.
    """
    seconds, steps = ([0.0, *(look[i] for look in final)] for i in (0, 1))
    return [np.array([np.interp(look[1], steps, seconds), *look[1:]]) for look in start]


def finalists(out: Path = OUT) -> dict[str, list[Looks]]:
    """The looks of the final, by learner, seed by seed; those of its start, where there are, in place of its first.

    All times are the final's: :func:`at_the_pace_of`.
    """
    looks: dict[str, dict[tuple[str, str], list[Array]]] = {}
    for row in read(out):
        look = np.array([float(row[name] or "nan") for name in Looks._fields])
        looks.setdefault(row["stage"], {}).setdefault((row["algorithm"], row["seed"]), []).append(look)
    final, starts = looks.get("final", {}), looks.get("start", {})
    learners: dict[str, list[Looks]] = {}
    for (name, seed), rows in final.items():
        start = at_the_pace_of(starts.get((name, seed), []), rows)
        further = [look for look in rows if not start or look[1] > start[-1][1]]
        columns = np.array([*start, *further]).T
        learners.setdefault(name, []).append(Looks(*columns[:-1], given=rows[0][-1]))
    return {name: learners[name] for name in PEERS if name in learners}


def tuning(out: Path = OUT) -> Summary:
    """What each setting that was tried came to, and what is changed in the one that went into the final."""
    table, rows = [], read(out)
    for name in PEERS:
        samples = tuned(rows, name)
        if not samples:
            continue
        best = max(samples, key=lambda sample: samples[sample][0])
        known, chosen = (samples[sample][1] for sample in (0, best))
        changed = ", ".join(f"{key} {value}" for key, value in chosen.items() if value != known.get(key))
        speeds = ", ".join(f"{samples[sample][0]:.2f}" for sample in sorted(samples))
        table.append((NAMES[name], speeds, changed or "the best known"))
    return Summary(
        "", ("learner", "settings tried, m/s", "into the final, but for what is best known"), table
    )


def finals(out: Path = OUT) -> Summary:
    """Median time to each speed and how many seeds got there; what all came to."""
    rows = []
    for name, learners in finalists(out).items():
        times = []
        for speed in SPEEDS:
            what = reached(learners, speed, "cpu_seconds")
            there = int(np.isfinite(what.spent).sum())
            median = f"{'' if what.known else '> '}{number(what.median)}"
            times.append(f"{median} ({there})" if there else "none")
        lasts = (
            np.array([one.last(getattr(one, of)) for one in learners]) for of in ("speed", "steady_speed")
        )
        given = f"{min(one.given for one in learners):.0f}"
        rows.append((NAMES[name], str(len(learners)), given, *times, *map(_middle, lasts)))
    head = ("learner", "seeds", "s for each", *(f"s to {speed} m/s" for speed in SPEEDS),
            "last window, m/s: median; mean", "steady, m/s: median; mean")  # fmt: skip
    return Summary("", head, rows)


def _middle(values: Array) -> str:
    """Median and mean; of a few seeds, each."""
    if np.isnan(values).any():
        return "-"
    if len(values) < 5:
        return ", ".join(map("{:.2f}".format, values))
    return f"{np.median(values):.2f}; {mean_and_interval_text(values)}"


def soonest(
    everyone: Mapping[str, Sequence[Looks]], speed: float, quantity: str
) -> tuple[str, Reached] | None:
    """The peer that reaches a speed by the least of a quantity, if any does: by the least that its median can be."""
    there = {
        name: what
        for name, learners in everyone.items()
        if name not in OURS
        and all(getattr(one, quantity)[-1] > 0 for one in learners)
        and np.isfinite((what := reached(learners, speed, quantity)).spent).any()
    }
    if not there:
        return None
    name = min(there, key=lambda name: (there[name].median, not there[name].known))
    return name, there[name]


def ratio_text(ours: Reached, other: Reached) -> str:
    """What ours had spent over what the other had, medians, as far as they are known."""
    if not ours.known:
        return ""
    share = ours.median / other.median
    text = f"{share:.2f}" if share >= 0.1 else f"1/{int(1 / share + 0.5 * other.known)}"
    return f"{'' if other.known else 'at most '}{text}"


def goal_text(ours: Reached, other: Reached, goal: float | None) -> str:
    """Whether the ratio of the medians is known to be no more than the goal, if there is one."""
    if goal is None:
        return ""
    return f"1/{1 / goal:.0f}: {'met' if ours.known and ours.median <= goal * other.median else 'missed'}"


def against_the_fastest(out: Path = OUT, mine: Name = "ours") -> Summary:
    """One of ours beside the peer that reaches each speed by the least of each quantity: medians, and their ratio."""
    everyone, rows = finalists(out), []
    for speed in SPEEDS:
        for quantity, (unit, goal) in GOALS.items():
            ours = reached(everyone[mine], speed, quantity)
            found = soonest(everyone, speed, quantity)
            if found is None:
                rows.append((f"{speed} m/s", unit, median_words(ours, unit), "no peer got there", "", ""))
                continue
            name, other = found
            label = f"{NAMES[name]}: {median_words(other, unit)}, {other.got_there}"
            words = f"{median_words(ours, unit)}, {ours.got_there}"
            ends = ratio_text(ours, other), goal_text(ours, other, goal)
            rows.append((f"{speed} m/s", unit, words, label, *ends))
    return Summary("", ("speed", "in", NAMES[mine], "the soonest peer", "ours to it", "goal"), rows)


def headline(peers: Sequence[str] = tuple(PEERS), speeds: Sequence[float] = SPEEDS, out: Path = OUT) -> str:
    """Time of value gradients to each speed over that of the soonest of some peers."""
    everyone, ratios = finalists(out), []
    rivals = {name: learners for name, learners in everyone.items() if name in peers}
    for speed in speeds:
        ours, found = reached(everyone["ours"], speed, "cpu_seconds"), soonest(rivals, speed, "cpu_seconds")
        ratios.append(ratio_text(ours, found[1]) if found else "no peer")
    return ", ".join(ratios)


def share_there(learners: Sequence[Looks], speed: float, quantity: str) -> tuple[Array, Array]:
    """Corners of the curve of how many of the seeds have reached a speed: spent so far, and their share."""
    spent = np.sort(reached(learners, speed, quantity).spent)
    spent = spent[np.isfinite(spent)]
    return np.repeat(spent, 2), np.repeat(np.arange(len(spent) + 1), 2)[1:-1] / len(learners)


def _speeds(axes: Axes, learners: Sequence[Looks], quantity: str, **style: object) -> None:
    """Mean over the seeds, as far as all were looked at."""
    spent = [getattr(one, quantity) for one in learners]
    at = np.geomspace(max(x[0] for x in spent), min(x[-1] for x in spent), 200)
    axes.plot(
        at,
        np.mean([np.interp(at, x, one.speed) for x, one in zip(spent, learners, strict=True)], axis=0),
        **style,
    )


def _styles() -> dict[str, dict[str, Any]]:
    """Ours in one colour, the others each in its own; neighbours differ in their dashes too."""
    others = [name for name in PEERS if name not in OURS]
    colors = dict.fromkeys(OURS, BLUE) | dict(zip(others, (c for c in COLORS if c != BLUE), strict=False))
    return {
        name: {"color": colors[name], "linestyle": style, "linewidth": 1.6}
        for name, style in zip(PEERS, cycle(STYLES), strict=False)
    }


def draw(everyone: Mapping[str, Sequence[Looks]]) -> Figure:
    """Speeds, and the share of seeds that are there, against time, simulation and gradients."""
    fastest = max(one.speed.max() for learners in everyone.values() for one in learners)
    speeds = [speed for speed in SPEEDS if speed <= fastest]
    figure = Figure(figsize=(9.6, 3.6 + 1.5 * len(speeds)), layout="constrained")
    grid = figure.subplots(1 + len(speeds), len(AXES), sharex="col", height_ratios=[2, *([1] * len(speeds))])
    styles = _styles()
    for column, quantity in zip(grid.T, AXES, strict=True):
        for axes in column:
            plain_axes(axes)
            axes.set_xscale("log")
        for name, learners in everyone.items():
            if not all(getattr(one, quantity)[0] > 0 for one in learners):
                continue
            _speeds(column[0], learners, quantity, **styles[name])
            end = min(getattr(one, quantity)[-1] for one in learners)
            for axes, speed in zip(column[1:], speeds, strict=True):
                spent, share = share_there(learners, speed, quantity)
                if spent.size:
                    axes.plot([*spent, max(end, spent[-1])], [*share, share[-1]], **styles[name])
        column[-1].xaxis.set_major_formatter(EngFormatter(sep=""))
        column[-1].set_xlabel(AXES[quantity])
        for axes in column[1:]:
            axes.set_ylim(-0.03, 1.05)
            axes.yaxis.set_major_locator(MultipleLocator(0.5))
    grid[0, 0].set_ylabel("mean speed  (m/s)")
    for axes, speed in zip(grid[1:, 0], speeds, strict=True):
        axes.set_ylabel(f"seeds at {speed} m/s")
    for row in grid:
        for axes in row[1:]:
            axes.tick_params(labelleft=False)
            axes.sharey(row[0])
    handles = [
        Line2D(
            [], [], label=f"{NAMES[name]}, {len(learners)} seed{'s' * (len(learners) > 1)}", **styles[name]
        )
        for name, learners in everyone.items()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False)
    return figure


def main(log: Path = OUT, picture: Path = PLOT) -> None:
    """Draw the final.

    Args:
        log: CSV of looks at learners.
        picture: Where to draw it.
    """
    everyone = finalists(log)
    if not everyone:
        raise SystemExit(f"there is no final in {log}; run tournament.py tune and final first")
    save_figure(draw(everyone), picture)


if __name__ == "__main__":
    tyro.cli(main)
