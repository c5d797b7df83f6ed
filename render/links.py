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
from swimmer_mj.render.figures import BLUE, COLORS, GREY, INK, ORANGE, plain_axes

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


def speed_by_links(
    speeds: Mapping[str, Mapping[int, Array]] | None = None, mark: Known | None = None
) -> Figure:
    """Mean over seeds of the best speed, with its 95 % interval, against the number of links.

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
    for k, ((label, by_links), color) in enumerate(
        zip(speeds.items(), (BLUE, COLORS[2], ORANGE), strict=False)
    ):
        numbers = np.array(sorted(by_links)) + 0.06 * (k - 1)  # intervals beside each other
        found = [mean_and_interval(by_links[n]) for n in sorted(by_links)]
        axes.plot(
            numbers,
            [mean for mean, _ in found],
            color=color,
            marker="o",
            markersize=5,
            linewidth=1.5,
            label=label,
        )
        for n, (_, interval) in zip(numbers, found, strict=True):
            if known_interval(interval) is not None:
                axes.plot([n, n], interval, color=color, linewidth=2.2, solid_capstyle="butt")
        for n, of_seeds in zip(numbers, (by_links[n] for n in sorted(by_links)), strict=True):
            axes.plot(np.full(len(of_seeds), n), of_seeds, "_", color=GREY, markersize=7, zorder=1.5)
    axes.plot(
        *zip(*OPEN_LOOP_SPEED.items(), strict=True),
        color=INK, linewidth=1.1, linestyle=(0, (5, 3)), marker="s", markersize=4, label="open-loop wave",
    )  # fmt: skip
    if mark is not None:
        axes.plot(
            mark.links,
            mark.speed,
            "*",
            color=INK,
            markersize=15,
            markeredgecolor="white",
            label=mark.label,
            zorder=4,
        )
    numbers = {n for by_links in speeds.values() for n in by_links} | ({mark.links} if mark else set())
    axes.set_xticks(sorted(numbers))
    axes.set_xlabel("links")
    axes.set_ylabel("swimming speed  (m/s)")
    axes.set_ylim(bottom=min(0.0, mark.speed if mark else 0.0))
    axes.margins(x=0.06)
    axes.set_title("best of each seed (dashes), their mean and its 95 % interval", fontsize=9, loc="left")
    axes.legend(frameon=False, fontsize=9)
    return figure
