"""How fast a wave of torques swims that looks at nothing: what a policy must beat to have learned anything.

    python benchmarks/open_loop_wave.py

Torques are at their limits, U sign(sin(2 pi t / T - i lag)) at joint i. All periods T and lags of a grid are swum from
16 starts: at rest, each link within 0.1 rad of one line. The speed is the distance between where the centre of mass
is after 10 s and after 20 s, in whatever direction, over 10 s: such a swimmer cannot steer. The grid is swum on the
compiled equations; the best few waves on MuJoCo, from other starts. Rows go to results/open-loop-wave.csv.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from peers.engine import SwimEngine
from rich.console import Console
from yardstick import CONTROL_TIMESTEP

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.environments.vector import SwimmerVectorEnv
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.problems.problem import EPISODE_DURATION, SETTLING_TIME
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.parameters import SwimmerParameters

OUT = Path(__file__).parent / "results" / "open-loop-wave.csv"
COLUMNS = ("links", "period", "lag", "speed", "speed_on_mujoco")
PERIODS, LAGS = np.geomspace(0.3, 4.0, 48), np.linspace(-np.pi, np.pi, 48, endpoint=False)
"""s; rad from joint to joint."""
FINALISTS = 16
"""Of the grid, which are swum on MuJoCo."""
Array = NDArray[np.float64]


def wave(n_joints: int, period: Array, lag: Array, t: float) -> Array:
    """Torques in units of the largest, (n_joints, N), of waves with period and lag (N,)."""
    phase = 2 * np.pi * t / period - np.arange(n_joints)[:, None] * lag
    return np.where(np.sin(phase) >= 0, 1.0, -1.0)


def starts(n_links: int, count: int, seed: int) -> Array:
    """At rest, almost straight, (count, 2n + 2)."""
    states = np.zeros((count, 2 * n_links + 2))
    states[:, :n_links] = np.random.default_rng(seed).uniform(-0.1, 0.1, (count, n_links))
    return states


def net_speed(step: Callable[[float], Array]) -> Array:
    """Of N swimmers whose velocity, (2, N), ``step(t)`` gives after the control step that begins at t, s."""
    count, settled = (round(t / CONTROL_TIMESTEP) for t in (EPISODE_DURATION, SETTLING_TIME))
    velocities = [step(k * CONTROL_TIMESTEP) for k in range(count)]
    return np.hypot(*np.mean(velocities[settled:], axis=0))


def on_equations(n_links: int, period: Array, lag: Array, seed: int) -> Array:
    """Speed of waves (N,), the mean over starts, m/s."""
    problem = Swimming(SwimmerParameters(n_links=n_links))
    engine, limits = SwimEngine(problem, CONTROL_TIMESTEP), problem.control_limits
    periods, lags = period.repeat(LANES), lag.repeat(LANES)
    x = np.tile(starts(n_links, LANES, seed).T, (1, len(period)))

    def step(t: float) -> Array:
        nonlocal x
        reached, _ = engine.forward(x, wave(n_links - 1, periods, lags, t) * limits[:, None])
        x = reached[-1]
        return x[2 * n_links :]

    return net_speed(step).reshape(-1, LANES).mean(axis=1)


def on_mujoco(n_links: int, period: float, lag: float, seed: int) -> float:
    """Speed of a wave, the mean over starts, m/s."""
    first = iter(starts(n_links, LANES, seed))
    swimmers = SwimmerVectorEnv(
        f"swim{n_links}",
        LANES,
        nthread=1,
        params=SwimmerParameters(n_links=n_links),
        initial_states=lambda _: next(first),
    )
    swimmers.reset(seed=0)
    alike = np.full(LANES, period), np.full(LANES, lag)

    def step(t: float) -> Array:
        return swimmers.step(wave(n_links - 1, *alike, t).T)[0][:, 2 * n_links :].T

    speed = net_speed(step).mean()
    swimmers.close()
    return float(speed)


def best_wave(n_links: int) -> tuple[int, str, str, str, str]:
    """A row: of the fastest waves of the grid, the one that is fastest on MuJoCo."""
    periods, lags = (grid.ravel() for grid in np.meshgrid(PERIODS, LAGS))
    speeds = on_equations(n_links, periods, lags, seed=0)
    best = np.argsort(speeds)[-FINALISTS:]
    there = [on_mujoco(n_links, periods[i], lags[i], seed=1) for i in best]
    k = int(np.argmax(there))
    i = best[k]
    return (n_links, f"{periods[i]:.4f}", f"{lags[i]:.4f}", f"{speeds[i]:.4f}", f"{there[k]:.4f}")


def main(out: Path = OUT) -> None:
    """Search with 3, 4 and 5 links.

    Args:
        out: CSV to write.
    """
    rows = [best_wave(n_links) for n_links in (3, 4, 5)]
    with out.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    note_made(out)
    for row in rows:
        Console().print(*row)


if __name__ == "__main__":
    tyro.cli(main)
