"""The best known gaits in numbers, as ``docs_tables.py`` writes them into docs/gaits.md."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from swimmer_mj.intervals import mean_and_interval_text
from swimmer_mj.learning.experiments.gaits.gait import GLIDE
from swimmer_mj.learning.experiments.summaries import Summary
from swimmer_mj.learning.experiments.tables import LOGS, read_table, rows_where, span

RESULTS = Path(__file__).parents[1] / "benchmarks" / "results"
MASS = 1.0
"""Of a link of the paper's swimmers, kg."""


def replays() -> Summary:
    """The gaits and what came of them on MuJoCo."""
    table = read_table(RESULTS / "gait-replays.csv")
    rows = []
    for i, n in enumerate(table["links"]):
        speed, pull, power = (float(table[name][i]) for name in ("speed", "pull", "power"))
        rows.append(
            (
                f"{n:.0f}",
                f"{speed:g}",
                f"{pull:.4f}",
                f"{table['duration'][i]:.3f}",
                f"{table['fold'][i]:.0f}° ({table['fold_joint'][i]:.0f} of {n - 1:.0f})",
                str(table["crossings"][i]),
                f"{table['saturated'][i]:.0%}",
                f"{power:.1f}",
                f"{power / speed:.1f}",
                f"{n * MASS * pull * speed / power:.0%}",
                f"{table['replayed_speed'][i]:.4f}",
                f"{table['largest_error'][i]:.2%}",
                f"{table['without_feedback'][i]:.2f}",
            )
        )
    header = (
        "links",
        "mean speed, m/s",
        "pull, m/s²",
        "stroke, s",
        "sharpest bend (joint)",
        "links that cross",
        "torques at their limits",
        "power, W",
        "work per metre, J/m",
        "of that against the pull",
        "on MuJoCo, m/s",
        "worst stroke off by",
        "without feedback, m/s",
    )
    return Summary("", header, rows)


def seconds_between(speeds: tuple[float, float], pulls: tuple[float, float]) -> float:
    """From one speed to another where the pull becomes acceleration: the integral of dV / a(V), log a linear in V."""
    (slow, fast), (strong, weak) = speeds, pulls
    return (fast - slow) / math.log(strong / weak) * (1 / weak - 1 / strong)


def accelerations() -> Summary:
    """How long it takes to gain speed with the best gaits and no pull."""
    table = read_table(RESULTS / "gait-replays.csv")
    rows = []
    for n in np.unique(table["links"]).tolist():
        pulls = {
            v: a for k, v, a in zip(table["links"], table["speed"], table["pull"], strict=True) if k == n
        }
        cells = [
            f"{seconds_between(pair, (pulls[pair[0]], pulls[pair[1]])):.1f}"
            if pulls.keys() >= {*pair}
            else "-"
            for pair in ((1.0, 2.0), (2.0, 3.0))
        ]
        rows.append((f"{n:.0f}", *cells))
    return Summary("", ("links", "from 1 to 2 m/s, s", "from 2 to 3 m/s, s"), rows)


STARTS = {"wave": "waves", "random": "random motions", "best": "other gaits", "learned": "learned strokes"}
"""Where solves began."""


def kind_of_start(start: str) -> str:
    """One of :data:`STARTS`, by what the log calls it; the strokes of policies are called by their names."""
    first = start.split()[0]
    return first if first in STARTS else "learned"


def basins() -> Summary:
    """What the solves of the log came to."""
    table = read_table(LOGS / "gaits.csv")
    rows = []
    for n in np.unique(table["links"]).tolist():
        for speed in np.unique(rows_where(table, links=n)["speed"]).tolist():
            one = rows_where(table, links=n, speed=speed)
            solved = one["kkt_residual"] <= 1e-6
            glides = solved & (np.abs(one["pull"]) <= GLIDE)
            swims = solved & (one["pull"] > GLIDE)
            best = one["pull"][swims].max() if swims.any() else math.nan
            near = swims & (one["pull"] > 0.99 * best)
            kinds = np.array([kind_of_start(str(start)) for start in one["start"]])
            counts = (f"{(near & (kinds == kind)).sum()} of {(kinds == kind).sum()}" for kind in STARTS)
            others = ", ".join(f"{pull:.3f}" for pull in sorted(one["pull"][swims & ~near], reverse=True))
            rows.append(
                (
                    f"{n:.0f}",
                    f"{speed:g}",
                    str(len(solved)),
                    str(int(near.sum())),
                    *counts,
                    others or "-",
                    str(int(glides.sum())),
                    str(int((~solved).sum())),
                    span(one["cpu_seconds"], ".0f"),
                )
            )
    header = (
        "links",
        "mean speed, m/s",
        "solves",
        "within 1 % of the best",
        *(f"of these from {name}" for name in STARTS.values()),
        "other gaits, m/s²",
        "glide",
        "not converged",
        "seconds each",
    )
    return Summary("", header, rows)


def shares() -> Summary:
    """Policies against the pulls of the best known gaits."""
    table = read_table(RESULTS / "gait-shares.csv")
    rows = []
    for i, name in enumerate(table["policy"].tolist()):
        pull, mean = float(table["pull"][i]), float(table["policy_speed"][i])
        best = float(table["best_speed"][i])
        share = f"{mean / best:.0%}" if best else "-"
        interval = f"{mean:.2f} [{table['low'][i]:.2f}, {table['high'][i]:.2f}]"
        folded = f"{table['folded'][i]:.0%}"
        rows.append((f"`{name}`", f"{pull:.4f}", f"{best:g}" if best else "no best", interval, share, folded))
    header = ("policy", "pull, m/s²", "best known gait, m/s", "policy, m/s", "share", "of the time folded")
    return Summary("", header, rows)


def ways_out() -> Summary:
    """What was tried to lead learners away from folding."""
    table = read_table(RESULTS / "ways-out.csv")
    rows = []
    for name in dict.fromkeys(table["name"].tolist()):
        of = rows_where(table, name=name)
        steps, folded = of["simulation_steps"] / 1e6, np.count_nonzero(of["folded"] > 0.5)
        speeds = (mean_and_interval_text(of[column]) for column in ("speed", "steady_speed"))
        rows.append(
            (name, str(len(steps)), f"{steps.mean():.1f}", *speeds, span(of["steady_speed"]), str(folded))
        )
    header = (
        "learner",
        "seeds",
        "million steps",
        "speed, m/s",
        "steady, m/s",
        "slowest to fastest",
        "folded",
    )
    return Summary("", header, rows)
