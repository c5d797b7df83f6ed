"""How fast do the shipped policies swim against the pulls of the best known gaits (docs/gaits.md)?

    python benchmarks/gait_shares.py

writes benchmarks/results/gait-shares.csv, a row a policy and pull (best_speed is 0 where there is no pull): mean
velocity of the centre of mass along x from 30 to 60 s, from the first 16 initial states of the evaluation, by A.3 and
RK4 at 0.01 s, and the share of that time in which the chain is folded. The policies were learned without a pull.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments.gaits.gait import BEST, Gait, load_gaits
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import read_table, write_table
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.pretrained import load_pretrained, pretrained_swimmers
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.parameters import SwimmerParameters

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "gait-shares.csv"
COLUMNS = ("policy", "links", "pull", "best_speed", "policy_speed", "low", "high", "folded")
DT, SETTLED, DURATION = 0.01, 30.0, 60.0
"""s."""
STARTS = 16
FOLD = np.pi / 2
"""A joint that is bent by more than this folds the chain, rad; no best gait does (docs/gaits.md)."""


class Swum(NamedTuple):
    """What a policy does against pulls, each of shape (pulls, STARTS)."""

    speed: NDArray[np.float64]
    """m/s."""
    folded: NDArray[np.float64]
    """Share of the time in which some joint is bent by more than :data:`FOLD`."""


def best_gaits(links: int) -> dict[float, Gait]:
    """The best known by their speed, m/s."""
    return load_gaits(BEST / f"swim{links}.npz")


def swim(
    policy: GreedyPolicy[Any],
    pulls: NDArray[np.float64],
    settled: float = SETTLED,
    duration: float = DURATION,
) -> Swum:
    """A policy against each pull, m/s^2, from ``settled`` to ``duration``, s."""
    n = (policy.problem.state_size - 2) // 2
    p = SwimmerParameters(n_links=n)
    swimmer = AnalyticSwimmer(p)
    z = np.tile(evaluation_states(n)[:STARTS], (len(pulls), 1))
    back = np.repeat(pulls, STARTS)
    way, folded = np.zeros(len(z)), np.zeros(len(z))
    for k in range(round(duration / DT)):
        u = policy.judge(z).control
        x = rk4_step(lambda y, u=u: swimmer.derivative(y, u), st.expand(p, z), DT)
        if k >= round(settled / DT):
            way += st.center_of_mass(p, x)[:, 0] - back * DT**2 / 2
            bends = np.angle(np.exp(1j * np.diff(z[:, :n], axis=1)))  # whole turns make no difference
            folded += (np.abs(bends) > FOLD).any(axis=1)
        z = st.reduce(p, x)
        z[:, -2] -= back * DT  # split from the rest: all points are accelerated alike
    steps, shape = round((duration - settled) / DT), (len(pulls), STARTS)
    return Swum((way / (duration - settled)).reshape(shape), (folded / steps).reshape(shape))


def main(policies: tuple[str, ...] = pretrained_swimmers(), out: Path = OUT) -> None:
    """Measure each.

    Args:
        policies: Their names; the rows of others stay as they are.
        out: CSV.
    """
    torch.set_num_threads(1)
    for name in policies:
        links = int(name[4])
        best = best_gaits(links)
        pulls = np.array([0.0, *(gait.pull for gait in best.values())])
        new: list[tuple[str | float, ...]] = []
        swum = swim(load_pretrained(name).policy, pulls)
        for pull, best_speed, speeds, folded in zip(pulls, (0.0, *best), *swum, strict=True):
            mean, (low, high) = mean_and_interval(speeds)
            new.append((name, links, pull, best_speed, mean, low, high, folded.mean()))
            print(*new[-1], flush=True)
        kept = read_table(out) if out.exists() else {column: np.array([]) for column in COLUMNS}
        old = [row for row in zip(*(kept[c].tolist() for c in COLUMNS), strict=True) if row[0] != name]
        write_table(out, COLUMNS, sorted([*old, *new], key=lambda row: (row[0], row[2])))
        note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
