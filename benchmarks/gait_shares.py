"""How fast do the shipped policies swim against the pulls of the best known gaits (docs/gaits.md)?

    python benchmarks/gait_shares.py

writes benchmarks/results/gait-shares.csv, a row a policy and pull (best_speed is 0 where there is no pull): mean
velocity of the centre of mass along x from 10 to 15 s, from the first 4 initial states of the evaluation, by A.3 and
RK4 at 0.01 s. The policies were learned without a pull.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import tyro

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments.gaits.gait import BEST, load_gaits
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.tables import read_table, write_table
from swimmer_mj.learning.pretrained import load_pretrained, pretrained_names
from swimmer_mj.learning.problems.swim.environment import evaluation_states
from swimmer_mj.parameters import SwimmerParameters

OUT = Path(__file__).parents[1] / "benchmarks" / "results" / "gait-shares.csv"
COLUMNS = ("policy", "links", "pull", "best_speed", "policy_speed", "low", "high")
DT, SETTLED, DURATION = 0.01, 10.0, 15.0
"""s."""
STARTS = 4


def speeds(name: str, pulls: np.ndarray) -> np.ndarray:
    """Of a policy against each pull, m/s, shape (pulls, STARTS)."""
    policy = load_pretrained(name).policy
    n = (policy.problem.state_size - 2) // 2
    p = SwimmerParameters(n_links=n)
    swimmer = AnalyticSwimmer(p)
    z = np.tile(evaluation_states(n)[:STARTS], (len(pulls), 1))
    back = np.repeat(pulls, STARTS)
    way = np.zeros(len(z))
    for k in range(round(DURATION / DT)):
        u = policy.judge(z).control
        x = rk4_step(lambda y, u=u: swimmer.derivative(y, u), st.expand(p, z), DT)
        if k >= round(SETTLED / DT):
            way += st.center_of_mass(p, x)[:, 0] - back * DT**2 / 2
        z = st.reduce(p, x)
        z[:, -2] -= back * DT  # split from the rest: all points are accelerated alike
    return (way / (DURATION - SETTLED)).reshape(len(pulls), STARTS)


def main(policies: tuple[str, ...] = pretrained_names(), out: Path = OUT) -> None:
    """Measure each.

    Args:
        policies: Their names; the rows of others stay as they are.
        out: CSV.
    """
    torch.set_num_threads(1)
    for name in policies:
        links = int(name[4])
        best = load_gaits(BEST / f"swim{links}.npz")
        pulls = np.array([0.0, *(gait.pull for gait in best.values())])
        new: list[tuple[str | float, ...]] = []
        for pull, best_speed, found in zip(pulls, (0.0, *best), speeds(name, pulls), strict=True):
            mean, (low, high) = mean_and_interval(found)
            new.append((name, links, pull, best_speed, mean, low, high))
            print(*new[-1], flush=True)
        kept = read_table(out) if out.exists() else {column: np.array([]) for column in COLUMNS}
        old = [row for row in zip(*(kept[c].tolist() for c in COLUMNS), strict=True) if row[0] != name]
        write_table(out, COLUMNS, sorted([*old, *new], key=lambda row: (row[0], row[2])))
        note_made(out)


if __name__ == "__main__":
    tyro.cli(main)
