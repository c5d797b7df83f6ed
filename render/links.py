"""Speed against the number of links, of every way to swim that there are logs of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swimmer_mj.intervals import known_interval, mean_and_interval
from swimmer_mj.learning.experiments import value_gradients
from swimmer_mj.learning.experiments.summaries import peaks
from swimmer_mj.learning.experiments.tables import LOGS, Path, read_table, rows_where
from swimmer_mj.render.curves import OPEN_LOOP_SPEED
from swimmer_mj.render.figures import BLUE, GREEN, GREY, HANDLE, INK, ORANGE, line, plain_axes

__all__ = ["Known", "best_speeds", "speed_by_links"]

Array = NDArray[np.float64]


class Known(NamedTuple):
    """A point: a swimmer of so many links and its speed."""

    label: str
    links: int
    speed: float
    """m/s."""


def best_speeds(logs: Path = LOGS) -> dict[str, dict[int, Array]]:
    """The best speed of each seed, m/s, by learner and number of links."""
    td = {n: read_table(Path(logs) / f"swim{n}.csv") for n in (3, 4, 5)}
    table = read_table(Path(logs) / value_gradients.LINKS_LOG)
    numbers = [int(n) for n in np.unique(table["setting"])]
    return {
        "value gradients": {n: _best(rows_where(table, setting=float(n))) for n in numbers},
        "TD(λ), η = 0.16": {
            n: np.array([peak.peak for peak in peaks(one, "tuned")]) for n, one in td.items()
        },
        "TD(λ), η = 0.01, the paper's": {
            n: np.array([peak.peak for peak in peaks(one, "paper")]) for n, one in td.items()
        },
    }


def _best(table: Mapping[str, NDArray]) -> Array:
    return np.array([table["speed"][table["seed"] == seed].max() for seed in np.unique(table["seed"])])


def _drawn(place: Mapping[int, float], of: Mapping[int, float], beside: float = 0.0) -> tuple[Array, Array]:
    """Where values stand, and the values; NaN between numbers of links that do not follow each other."""
    numbers = np.array([*of])
    points = np.array([[place[n] + beside for n in of], [*of.values()]])
    x, y = np.insert(points, np.flatnonzero(np.diff(numbers) > 1) + 1, np.nan, axis=1)
    return x, y


def speed_by_links(
    speeds: Mapping[str, Mapping[int, Array]] | None = None, mark: Known | None = None
) -> Figure:
    """Mean over seeds of the best speed, with its 95 % interval, against the number of links.

    Numbers of links stand side by side; lines do not go over those that are left out.

    Parameters
    ----------
    speeds : mapping, optional
        Of each learner and number of links, the best speed of each seed, m/s; :func:`best_speeds` by default.
    mark : Known, optional
        A swimmer to be compared: a star.
    """
    speeds = best_speeds() if speeds is None else speeds
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.subplots()
    plain_axes(axes)
    shown = {n for by_links in (*speeds.values(), OPEN_LOOP_SPEED) for n in by_links}
    numbers = sorted(shown | ({mark.links} if mark else set()))
    place = {n: float(k) for k, n in enumerate(numbers)}
    for k, ((label, by_links), color, marker) in enumerate(
        zip(speeds.items(), (BLUE, GREEN, ORANGE), "o^D", strict=False)
    ):
        beside = 0.06 * (k - 1)
        found = {n: mean_and_interval(by_links[n]) for n in sorted(by_links)}
        axes.plot(
            *_drawn(place, {n: mean for n, (mean, _) in found.items()}, beside),
            marker=marker,
            markersize=5.5,
            linewidth=1.5,
            label=label,
            **line(color),
        )
        for n, (_, interval) in found.items():
            x = place[n] + beside
            if known_interval(interval) is not None:
                axes.plot([x, x], interval, color=color, linewidth=2.2, solid_capstyle="butt")
            of_seeds = by_links[n]
            axes.plot(np.full(len(of_seeds), x), of_seeds, "_", color=GREY, markersize=7, zorder=1.5)
    axes.plot(
        *_drawn(place, OPEN_LOOP_SPEED),
        linewidth=1.1,
        marker="s",
        markersize=4,
        label="open-loop wave",
        **line(INK),
    )
    if mark is not None:
        axes.plot(
            place[mark.links],
            mark.speed,
            "*",
            color=INK,
            markersize=15,
            markeredgecolor="white",
            label=mark.label,
            zorder=4,
        )
    axes.set_xticks(range(len(numbers)), [str(n) for n in numbers])
    axes.set_xlabel("links")
    axes.set_ylabel("swimming speed  (m/s)")
    axes.set_ylim(bottom=min(0.0, mark.speed if mark else 0.0))
    axes.margins(x=0.06)
    axes.set_title("best of each seed (dashes), their mean and its 95 % interval", fontsize=9, loc="left")
    axes.legend(frameon=False, fontsize=9, handlelength=HANDLE)
    return figure
